import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import typer

from mbot_protocol.errors import RefusedError
from mbot_workstation.cli.presenter import Answer, present, table, transfer_bar, working


@dataclass(frozen=True)
class Walk:
    """A path, and how long it was."""

    path: Path
    lengths_m: "np.ndarray[tuple[int], np.dtype[np.float64]]"
    longest_m: np.float64


WALK = Walk(Path("walk.csv"), np.array([0.5, 1.5]), np.float64(1.5))


def test_a_program_reads_fields_and_a_person_reads_words(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = [("one[/]", "0.5"), ("another", "1.5")]
    answer = Answer(WALK, ["two walks", table(("walk", "m"), rows, right=("m",))], ["it rained"])
    present(answer, as_json=True)
    out, errors = capsys.readouterr()
    assert json.loads(out) == {"path": "walk.csv", "lengths_m": [0.5, 1.5], "longest_m": 1.5}
    assert errors == "workstation: note: it rained\n"
    present(answer, as_json=False)
    said, *lines = capsys.readouterr().out.splitlines()
    assert said == "two walks"
    assert [tuple(line.split()) for line in lines] == [("walk", "m"), *rows]


def test_words_are_not_made_for_a_program() -> None:
    present(Answer([], (str(1 / 0) for _ in "a")), as_json=True)


def test_what_went_wrong_comes_after_what_was_found(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RefusedError):
        present(Answer({"a": 1}, error=RefusedError("no")), as_json=True)
    with pytest.raises(typer.Exit) as end:
        present(Answer({"a": 1}, exit_code=3), as_json=True)
    assert end.value.exit_code == 3
    assert capsys.readouterr().out.count("1") == 2


def test_nothing_is_drawn_where_no_terminal_is(capsys: pytest.CaptureFixture[str]) -> None:
    with transfer_bar() as progress:
        task = progress.add_task("sending to mbot-1", total=100)
        progress.update(task, completed=100)
        assert progress.finished
    with working("looking", 2) as done:
        done(1)
    assert capsys.readouterr() == ("", "")
