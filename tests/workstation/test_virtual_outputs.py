"""Where the virtual robot's port is found, and what is left of its drive."""

import json
import time
from pathlib import Path

import pytest

from mbot_protocol.drive.mcore import Joystick
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.pose import Pose
from mbot_workstation.tasks.fetch.episode import Happening
from mbot_workstation.virtual.live_world import TaskEvent, WorldStatus
from mbot_workstation.virtual.port_link import PortLink
from mbot_workstation.virtual.trajectory import TrajectoryWriter
from mbot_workstation.virtual.viewer_window import check_display


def test_a_link_leads_to_the_port_until_it_is_removed(tmp_path: Path) -> None:
    place = tmp_path / "deep" / "board"
    link = PortLink(place, "/dev/pts/7")
    assert str(place.readlink()) == "/dev/pts/7"
    place.unlink()
    place.symlink_to("/dev/pts/8")
    link.remove()
    assert str(place.readlink()) == "/dev/pts/8", "somebody else's by now"
    newer = PortLink(place, "/dev/pts/9")  # what a dead process has left is replaced
    assert str(place.readlink()) == "/dev/pts/9"
    newer.remove()
    assert list(place.parent.iterdir()) == []


def test_a_link_in_use_is_left_to_its_robot(tmp_path: Path) -> None:
    link = PortLink(tmp_path / "board", "/dev/pts/7")
    with pytest.raises(ConfigurationError, match="another virtual robot, which still runs"):
        PortLink(tmp_path / "board", "/dev/pts/8")
    assert str((tmp_path / "board").readlink()) == "/dev/pts/7"
    link.remove()
    PortLink(tmp_path / "board", "/dev/pts/8").remove()


def test_a_file_is_not_replaced_by_a_link(tmp_path: Path) -> None:
    (tmp_path / "board").write_text("mine")
    with pytest.raises(ConfigurationError, match="--board another path"):
        PortLink(tmp_path / "board", "/dev/pts/7")
    assert (tmp_path / "board").read_text() == "mine"


def test_a_trajectory_is_a_json_object_a_line(tmp_path: Path) -> None:
    path = tmp_path / "path.jsonl"
    result = {"touches": 1, "score": 1.9}
    status = WorldStatus(
        1.0, Pose(0.1, 0.2, 0.3), (Pose(1, 2),), Joystick(0, 0), (0.0, 0.0), result, ended=False
    )
    with TrajectoryWriter(path) as writer:
        writer.add(status)
        writer.add_event(TaskEvent(1.5, Happening.TOUCH, 1.9, {"touches": 1}))
    moment, event = map(json.loads, path.read_text().splitlines())
    assert moment.pop("unix_s") == pytest.approx(time.time(), abs=60)
    assert moment == {"t": 1.0, "x": 0.1, "y": 0.2, "yaw": 0.3, "object": [1, 2, 0.0]}
    assert event == {"t": 1.5, "event": Happening.TOUCH.value, "score": 1.9}


def test_what_can_not_be_written_or_shown_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigurationError, match="can't write the trajectory"):
        TrajectoryWriter(tmp_path / "missing" / "path.jsonl")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ConfigurationError, match="display"):
        check_display()
