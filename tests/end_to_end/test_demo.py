"""`workstation demo`, the whole system at once, as a new user runs it."""

import json
from pathlib import Path

import cv2

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_workstation.look.demo.demo_run import LEAVES
from mbot_workstation.virtual.with_daemon import ROBOT_LOG

from ..ran import ran
from .processes import PROGRAMS


def test_the_demo_drives_and_leaves_what_it_promises(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    command = [PROGRAMS.format("workstation"), "demo", "--json", "--seconds", "25"]
    done = ran(*command, "--radius", "0.8", "--output", str(folder), timeout=110)
    assert done.stdout, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["touches"] >= 1
    assert done.returncode == (0 if result["touches"] >= 3 else 1)
    assert result["decisions"] >= 40
    picture = cv2.imread(str(folder / "contact-sheet.png"))
    assert picture is not None
    assert picture.shape[0] > 600
    assert {path.name for path in folder.iterdir()} <= {ROBOT_LOG, *LEAVES}
    recorded = read_drive(folder / "recording.mcap").beats
    assert sum(bool(beat.encoded) for beat in recorded) >= result["decisions"] - 4
    assert (folder / "agent.log").read_text().rstrip().endswith("ended")


def test_the_demo_does_not_delete_other_peoples_things(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    done = ran(PROGRAMS.format("workstation"), "demo", "--output", str(tmp_path))
    assert done.returncode == 2
    assert "holds other things" in done.stderr
    assert (tmp_path / "thesis.tex").exists()


def test_a_photograph_that_is_no_room_is_named_before_anything_starts(tmp_path: Path) -> None:
    photo = tmp_path / "square.png"
    cv2.imwrite(str(photo), cv2.resize(cv2.UMat(8, 8, cv2.CV_8UC3).get(), (64, 64)))
    command = [PROGRAMS.format("workstation"), "demo", "--panorama", str(photo)]
    done = ran(*command, "--output", str(tmp_path / "demo"))
    assert done.returncode == 2
    assert "square.png" in done.stderr
    assert not (tmp_path / "demo").exists()
