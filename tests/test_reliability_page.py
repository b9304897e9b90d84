"""The page of faults: what its generator says of the lane, of bars, and of tests that failed."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def reliability(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import reliability

    yield reliability
    for name in ("reliability", "fault_table", "machine"):
        sys.modules.pop(name, None)


def outcomes(reliability: ModuleType, stopped_ms: float, *, passed: bool = True) -> list[object]:
    fault = reliability.FAULTS[0]
    measured = {"stopped ms": stopped_ms, "recovered s": 1}
    return [reliability.Outcome(fault.tests[0], passed, measured)]


def row(reliability: ModuleType, effort: object, found: list[object]) -> list[str]:
    return reliability.row(reliability.FAULTS[0], found, effort).split(" | ")


def test_every_try_counts_in_the_thorough_lane_and_the_tests_in_the_quick_one(
    reliability: ModuleType,
) -> None:
    found = outcomes(reliability, 700)
    assert row(reliability, reliability.THOROUGH, found)[2:4] == ["700 ms; 1 s", "**no**"]
    assert row(reliability, reliability.QUICK, found)[3] == "yes"
    found = outcomes(reliability, 300, passed=False)
    assert row(reliability, reliability.QUICK, found)[3] == "**no**"
    assert row(reliability, reliability.QUICK, [])[2:4] == ["nothing; nothing", "**no**"]


def test_the_page_names_its_lane_its_command_and_how_much_was_tried(
    reliability: ModuleType,
) -> None:
    fault = next(fault for fault in reliability.FAULTS if "{garbage" in fault.name)
    command = "make reliability-quick RELIABILITY='--garbage 5000'"
    effort = reliability.replace(reliability.QUICK, garbage=5000)
    text = reliability.page({fault: []}, effort, command, 3.2)
    assert "`make reliability-quick RELIABILITY='--garbage 5000'`" in text
    assert "in 3 minutes" in text
    assert "The quick lane: every fault once, no soak" in text
    assert "| 5,000 pieces of serial garbage; partial write |" in text
    assert f"0 of {len(reliability.FAULTS)} faults" in text
    thorough = reliability.page({fault: []}, reliability.THOROUGH, "make reliability", 30)
    assert "The thorough lane: every fault 5 times" in thorough
    assert "100,000 pieces" in thorough


REPORT = """<testsuites><testsuite time="90.5">
<testcase classname="{module}" name="{name}[1]"><properties>
<property name="stopped ms" value="331"/></properties></testcase>
<testcase classname="tests.robot.test_arming" name="test_b"><failure/></testcase>
</testsuite></testsuites>"""


def test_what_a_run_of_all_tests_has_reported_makes_the_page_too(
    reliability: ModuleType, tmp_path: Path
) -> None:
    test = reliability.FAULTS[0].tests[0]
    module, _, name = test.partition("::")
    (tmp_path / "slow.xml").write_text(
        REPORT.format(module=module.removesuffix(".py").replace("/", "."), name=name)
    )
    assert reliability.reported(tmp_path) == [
        reliability.Outcome(test, True, {"stopped ms": 331.0}),
        reliability.Outcome("tests/robot/test_arming.py::test_b", False),
    ]
    assert reliability.suites_s(tmp_path) == 90.5
