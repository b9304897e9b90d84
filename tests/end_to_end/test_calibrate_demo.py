"""`workstation calibrate demo`: the afternoon of measuring, by the commands that a person types."""

import json
from pathlib import Path

import pytest

from mbot_workstation.measure.rehearsal.afternoon import LEAVES, TRUTH_FOLDER

from ..ran import ran
from .processes import PROGRAMS


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_afternoon_finds_the_robot_that_nobody_has_measured(tmp_path: Path) -> None:
    folder = tmp_path / "afternoon"
    command = [PROGRAMS.format("workstation"), "calibrate", "demo", "--json", "-o", str(folder)]
    done = ran(*command, "--seconds", "1.5", "--photos", "10", timeout=540)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    assert len(rows) >= 16
    for row in rows:
        assert row["found"] is not None, row
        assert abs(row["found"] - row["truth"]) < abs(row["nominal"] - row["truth"]), row
    assert (folder / "gap.html").stat().st_size > 100_000
    assert {path.name for path in folder.iterdir()} <= {TRUTH_FOLDER, *LEAVES}
