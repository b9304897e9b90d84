import pytest

from mbot_agent.models.trial import Finding, Trial, Verdict


class Bench:
    def __init__(self, clean_decisions: int) -> None:
        self.verdicts: list[Verdict] = []
        self.trial = Trial("abc", clean_decisions, self.verdicts.append)

    @property
    def findings(self) -> list[Finding]:
        return [verdict.finding for verdict in self.verdicts]


def test_clean_decisions_in_a_row_prove_a_model_once() -> None:
    bench = Bench(3)
    for _ in range(2):
        bench.trial.clean()
    bench.trial.failed("nonsense")
    for _ in range(2):
        bench.trial.clean()
    assert bench.trial.is_open
    bench.trial.clean()
    assert not bench.trial.is_open
    bench.trial.clean()
    assert bench.verdicts == [Verdict("abc", Finding.PROVEN)]


def test_three_failures_in_a_row_break_it_and_the_last_reason_is_told() -> None:
    bench = Bench(5)
    bench.trial.failed("first")
    bench.trial.failed("second")
    bench.trial.clean()
    for reason in ("third", "fourth", "fifth"):
        assert not bench.trial.is_broken
        bench.trial.failed(reason)
    bench.trial.failed("sixth")
    assert bench.trial.is_broken
    assert bench.verdicts == [Verdict("abc", Finding.BROKEN, "fifth")]


@pytest.mark.parametrize("clean_decisions", [0, 4])
def test_a_proven_model_can_still_break(clean_decisions: int) -> None:
    bench = Bench(clean_decisions)
    for _ in range(clean_decisions):
        bench.trial.clean()
    for _ in range(3):
        bench.trial.failed("nonsense")
    assert bench.findings[-1] is Finding.BROKEN


def test_ticks_without_a_question_show_that_the_daemon_lives() -> None:
    bench = Bench(3)
    for _ in range(2):
        bench.trial.idle()
    assert bench.findings == []
    for _ in range(8):
        bench.trial.idle()
    assert bench.verdicts == [Verdict("abc", Finding.SURVIVED)]
    assert bench.trial.is_open
    proven = Bench(0)
    proven.trial.idle()
    assert proven.findings == []


def test_a_model_that_is_proven_stays_so_whatever_comes() -> None:
    """It is not asked again while the robot stands, and nothing more is said of it."""
    bench = Bench(3)
    for _ in range(3):
        bench.trial.clean()
    bench.trial.failed("once")
    assert not bench.trial.is_open
    for _ in range(10):
        bench.trial.idle()
    assert bench.findings == [Finding.PROVEN]
