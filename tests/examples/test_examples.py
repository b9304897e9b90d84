"""Each example as a user runs it, without arguments: its output, its length, its time."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ..ran import without_robot

EXAMPLES = Path(__file__).parents[2] / "examples"
LONGEST_LINES = 30
LIMIT_S = 90.0
"""On a busy machine; most take 5 to 20 s."""

SAYS = {
    "watch.py": r"virtual-mbot +\d+: running, left [+-]\d\.\d\d, right [+-].*, brightness \d+\n",
    "square.py": r"side 1, stopped\n(.*\n)*virtual-mbot: side 4, stopped\n",
    "follow_red.py": r"nothing red, turning\n(.*\n)*\d+ red pixels, [+-]\d.\d\d aside, driving",
    "several_robots.py": r"ahead: anna manual, ben manual\n(.*\n)*back: anna manual, ben manual\n",
    "own_policy.py": r"(episode \d: reward 1\d\.\d\d, 10 of 10 touched\n){3}",
    "own_task.py": r"wheels \(0.5, -0.5\): earns -2.\d\d, turning has cost 1.\d\d\n",
    "evaluate_policy.py": r"(.*10 of 10 touched\n){3}red-cube: mean reward (19|20)\.\d\d of 21\n",
    "read_recording.py": r"13 beats in 4.8 s\n(.*\n)*13 pictures, shape \(64, 64, 3\), brightness",
    "gamepad.py": "",
}
FILES = sorted(EXAMPLES.glob("*.py"))


def run(*command: str) -> tuple[int, str, str]:
    """Told to end when its time is up, so that what it has started ends, too."""
    with subprocess.Popen(
        [sys.executable, *command],
        env=without_robot(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            out, errors = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGTERM)
            out, errors = process.communicate()
            pytest.fail(f"{command[0]} took longer than {LIMIT_S:.0f} s: {out}{errors}")
    return process.returncode, out, errors


def test_each_is_short_and_in_the_table() -> None:
    assert {file.name for file in FILES} == set(SAYS)
    table = (EXAMPLES / "README.md").read_text()
    for file in FILES:
        assert len(file.read_text().splitlines()) <= LONGEST_LINES, file.name
        assert f"| [{file.name}]({file.name}) |" in table


@pytest.mark.slow
@pytest.mark.parametrize("file", [one for one in FILES if SAYS.get(one.name)], ids=lambda f: f.name)
def test_it_runs_as_it_is(file: Path) -> None:
    code, out, errors = run(str(file))
    assert (code, errors) == (0, "")
    assert re.search(SAYS[file.name], out), out


@pytest.mark.slow
def test_without_a_gamepad_it_says_so_in_a_line() -> None:
    blocked = "import runpy, sys; sys.modules['evdev'] = None; runpy.run_path({!r})"
    code, out, errors = run("-c", blocked.format(str(EXAMPLES / "gamepad.py")))
    assert (code, out) == (1, "")
    assert re.fullmatch(r"gamepad\.py: --gamepad needs evdev: pip install .*\n", errors)


@pytest.mark.slow
def test_a_robot_that_is_not_there_is_the_last_line_of_the_error() -> None:
    code, out, errors = run(str(EXAMPLES / "square.py"), "no-such-robot.invalid")
    assert (code, out) == (1, "")
    assert "no-such-robot.invalid" in errors.splitlines()[-1]
    assert "UnreachableError" in errors.splitlines()[-1]
