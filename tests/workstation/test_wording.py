import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.v1.messages_pb2 import Decision, Fault
from mbot_workstation.wording import (
    LONGEST_TEXT,
    computer_words,
    degrees,
    fault_lines,
    metres,
    one_line,
    percent,
    seconds,
    short_digest,
    size_words,
    typed,
    waiting_words,
)


@given(st.text(max_size=2000))
def test_any_text_becomes_one_printable_line(text: str) -> None:
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= LONGEST_TEXT


def test_values_become_words() -> None:
    assert short_digest("ab" * 32) == "abababababab"
    assert short_digest("") == "none"
    assert (size_words(4600), size_words(2_410_000)) == ("4.6 kB", "2.41 MB")
    fault = Fault(kind="camera", detail="black\x1b[2J\npictures")
    computer = Decision(cpu_temperature_c=51.5, load_1min=0.75)
    assert computer_words(computer) == "52 °C, load 0.75"
    computer.under_voltage = True
    assert "under-voltage" in computer_words(computer)
    assert fault_lines([fault]) == ["camera: black [2J pictures"]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("camera-starting", "the camera is ready"),
        ("camera-black", "the camera is in order"),
        ("board-lost", "the board is back"),
        ("board-no-deadman", "the board is in order"),
        ("link-lost", "a workstation is connected"),
        ("model-failed", "it has another model"),
        ("from-a-newer-robot", "that is mended"),
    ],
)
def test_what_an_armed_robot_waits_for(kind: str, words: str) -> None:
    fault = Fault(kind=kind, detail="look")
    assert waiting_words([fault, fault]) == f"it drives when {words} ({kind}: look; {kind}: look)"


def test_an_armed_robot_without_a_fault_has_not_begun() -> None:
    assert waiting_words([]) == "it does not drive yet, and reports no fault"


def test_numbers_have_the_digits_and_units_of_their_size() -> None:
    assert [metres(value) for value in (0.0042, 0.032, 1.314)] == ["4.2 mm", "3.2 cm", "1.31 m"]
    assert [degrees(value) for value in (0.84, 123.4)] == ["0.8°", "123°"]
    assert [percent(share) for share in (0.0031, 0.024, 0.12, None)] == [
        "0.31 %",
        "2.4 %",
        "12 %",
        "not known",
    ]
    assert seconds(10.0) == "10 s"


SOURCES = Path(__file__).parents[2] / "workstation" / "mbot_workstation"

PLAIN = {
    *("robot_id", "router", "behind[0]", "who or 'NAME'", "options.name", "options.robot"),
    *("robots[0]", "endpoint.host", "name", "command", "right.value", "options"),
    *(
        "across",
        "done + ROUND_STEPS",
        "config.lessons[0]",
        "config.steps",
        "pitch",
        "roll",
        "steps",
    ),
}
"""What follows a command or an option in a text and holds no space: names, numbers, our words."""


def filled_in(path: Path) -> Iterator[tuple[int, str]]:
    """What is put behind `workstation COMMAND` or an option in a text, with its line."""
    for text in ast.walk(ast.parse(path.read_text())):
        if isinstance(text, ast.JoinedStr):
            for before, value in zip(text.values, text.values[1:], strict=False):
                words = before.value if isinstance(before, ast.Constant) else ""
                if (
                    isinstance(value, ast.FormattedValue)
                    and isinstance(words, str)
                    and re.search(r"((?<!this )workstation [a-z][a-z -]*|--[a-z-]+) $", words)
                ):
                    yield text.lineno, ast.unparse(value.value)


def test_paths_in_commands_that_are_printed_can_be_pasted() -> None:
    assert shlex.split(f"workstation identify {typed(Path('my runs/$a'))}")[2] == "my runs/$a"
    found = [
        (path.name, line, value)
        for path in sorted(SOURCES.rglob("*.py"))
        for line, value in filled_in(path)
    ]
    assert sum(value.startswith("typed(") for _, _, value in found) >= 10
    loose = [one for one in found if not one[2].startswith("typed(") and one[2] not in PLAIN]
    assert not loose
