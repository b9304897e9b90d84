import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.v1.messages_pb2 import STATE_RUNNING, Fault
from mbot_workstation.wording import (
    LONGEST_TEXT,
    degrees,
    fault_lines,
    metres,
    one_line,
    percent,
    seconds,
    short_digest,
    size_words,
    state_word,
    waiting_words,
)


@given(st.text(max_size=2000))
def test_any_text_becomes_one_printable_line(text: str) -> None:
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= LONGEST_TEXT


def test_values_become_words() -> None:
    assert state_word(STATE_RUNNING) == "running"
    assert state_word(77) == "state-77"
    assert short_digest("ab" * 32) == "abababababab"
    assert short_digest("") == "none"
    assert (size_words(4600), size_words(2_410_000)) == ("4.6 kB", "2.41 MB")
    fault = Fault(kind="camera", detail="black\x1b[2J\npictures")
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
