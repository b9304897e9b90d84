"""Another object from a file to a drive, as docs/objects.md prints it: train, export, demo."""

import json
from pathlib import Path
from typing import Any

import pytest

from ..ran import ran
from .processes import PROGRAMS

CHECKOUT = Path(__file__).parents[2]
BALL = str(CHECKOUT / "models" / "objects" / "green-ball.toml")


def workstation(folder: Path, *words: str) -> dict[str, Any]:
    done = ran(PROGRAMS.format("workstation"), *words, "--json", cwd=folder, timeout=170)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_shipped_policy_turned_to_green_fetches_the_ball(tmp_path: Path) -> None:
    shipped = str(CHECKOUT / "models" / "red-cube-run")
    short = ("--steps", "64", "--robots", "1", "--workers", "1", "--made-up-rooms", "1")
    workstation(tmp_path, "train", "--name", "ball", "--from", shipped, "--object", BALL, *short)
    workstation(tmp_path, "export", "runs/ball", "-o", "ball.onnx")
    drive = ("--object", BALL, "--radius", "0.9", "--seconds", "60")
    result = workstation(tmp_path, "demo", "--model", "ball.onnx", *drive)
    assert result["success"]
    assert result["touches"] >= 3
