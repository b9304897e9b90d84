"""The README's recipe without hardware, as printed, in an empty folder."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from .processes import until

README = Path(__file__).parents[2] / "README.md"


def blocks(section: str) -> list[str]:
    """The shell blocks of a section."""
    text = README.read_text().partition(f"## {section}\n")[2].partition("\n## ")[0]
    found = re.findall(r"(?:^    .*\n)+", text, re.M)
    return [re.sub(r"^    ", "", block, flags=re.M) for block in found]


def shell(script: str, folder: Path, environment: dict[str, str], log: Path) -> subprocess.Popen:
    with log.open("wb") as output:
        return subprocess.Popen(
            ["bash", "-ec", script],
            cwd=folder,
            env=environment,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


@pytest.mark.timeout(180)
@pytest.mark.parametrize("desktop", [True, False], ids=["desktop", "no XDG_RUNTIME_DIR"])
def test_the_recipe_without_a_robot_drives_as_printed(tmp_path: Path, desktop: bool) -> None:
    (tmp_path / ".venv").symlink_to(sys.prefix)
    environment = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin", "PYTHONUNBUFFERED": "1"}
    if "PYTHONPATH" in os.environ:  # a checkout that is not the installed one
        environment["PYTHONPATH"] = os.environ["PYTHONPATH"]
    if desktop:
        environment["XDG_RUNTIME_DIR"] = str(tmp_path)
    robot, daemon = blocks("Without a robot")
    (drive,) = (block for block in blocks("On a robot") if "push-model" in block)
    lines = [line for line in drive.splitlines() if line.split()[0] == "workstation"]
    third = ". .venv/bin/activate\n" + "\n".join(line for line in lines if "telemetry" not in line)
    logs = [tmp_path / name for name in ("robot.log", "daemon.log", "third.log")]
    running: list[subprocess.Popen] = []
    try:
        running.append(shell(robot, tmp_path, environment, logs[0]))
        assert until(lambda: "next, in another terminal" in logs[0].read_text(), 60), logs[0]
        running.append(shell(daemon, tmp_path, environment, logs[1]))
        assert until(lambda: "robot virtual is up" in logs[1].read_text(), 30), logs[1].read_text()
        done = shell(third, tmp_path, environment, logs[2])
        assert done.wait(60) == 0, logs[2].read_text() + logs[1].read_text()
        assert until(lambda: "now running" in logs[1].read_text(), 10), logs[1].read_text()
    finally:
        for process in reversed(running):
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(20)
