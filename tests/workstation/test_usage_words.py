"""Mistakes in the words of a command line, each one line, and exit code 2."""

import json
import os
from collections.abc import Callable

import pytest

from mbot_workstation import main
from mbot_workstation.cli.usage_words import is_usage_error

from ..ran import WORKSTATION, ran

Ended = Callable[[str], tuple[object, str, str]]
WORDS = [
    ("evaluat servo", "no such command 'evaluat'; did you mean evaluate? see `workstation --help`"),
    (
        "evaluate servo --episode 1",
        "no such option: --episode; did you mean --episodes? see `workstation evaluate --help`",
    ),
    ("keys lst", "no such command 'lst'; did you mean list? see `workstation keys --help`"),
    ("zzz", "no such command 'zzz'; see `workstation --help`"),
    ("evaluate", "missing argument 'MODEL...'; see `workstation evaluate --help`"),
    ("enroll x --right fly", "'fly' is not one of 'view', 'push', 'drive'; see"),
    ("evaluate servo --episodes 0", "invalid value for '--episodes'"),
    ("evaluate servo --lesson rugh", "; did you mean rough?"),
    ("evaluate servo --preset handicapp", "; did you mean handicap?"),
    ("study latncy servo", "; did you mean latency?"),
    ("maneuvers run --yes --maneuver forward-forwrd", "; did you mean forward-forward?"),
    ("drive nan 0.2", "'nan', expected a number, at most 1"),
    ("drive 0.2 -- -2", "'-2', expected a number, at least -1"),
    ("train --lesson rugh", "--lesson: no lesson 'rugh'"),
]


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Ended:
    """Types a line; the exit code, what came out and what went to standard error."""

    def run(line: str) -> tuple[object, str, str]:
        monkeypatch.setattr("sys.argv", ["workstation", *line.split()])
        with pytest.raises(SystemExit) as end:
            main.main()
        out, errors = capsys.readouterr()
        return end.value.code, out, errors

    return run


@pytest.mark.parametrize(("line", "said"), WORDS)
def test_a_mistake_is_one_line_with_what_may_have_been_meant(
    line: str, said: str, ended: Ended
) -> None:
    code, out, errors = ended(line)
    assert (code, out) == (2, "")
    assert errors.startswith("workstation: ")
    assert errors.count("\n") == 1
    assert said in errors


@pytest.mark.parametrize("line", ["robots --jsn --json", "evaluate --json", "robot --json"])
def test_a_program_is_told_of_a_mistake_as_of_any_error(line: str, ended: Ended) -> None:
    code, out, errors = ended(line)
    assert (code, out) == (2, "")
    error = json.loads(errors)["error"]
    assert (error["kind"], error["facts"]) == ("usage", {})
    assert error["text"].endswith(f"; {error['remedy']}")


def test_no_words_at_all_show_the_help_and_nothing_else(ended: Ended) -> None:
    code, out, errors = ended("")
    assert code == 2
    assert "push-model" in out + errors
    assert "workstation:" not in out + errors


def test_a_shell_completes_subcommands() -> None:
    asked = {"_WORKSTATION_COMPLETE": "complete_bash", "COMP_WORDS": "workstation ev"}
    done = ran(*WORKSTATION, env=os.environ | asked | {"COMP_CWORD": "1"})
    assert (done.returncode, done.stdout.split()) == (0, ["evaluate"])


def test_other_errors_are_none_of_the_words() -> None:
    assert not is_usage_error(ValueError("x"))
