"""A virtual robot's path, read while it is written."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from mbot_protocol.drive.mcore import Joystick
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.look.drives.driven_path import (
    LONGEST_PATH,
    DrivenPath,
    PathFile,
    Place,
    Point,
)
from mbot_workstation.look.drives.live_view import MapLog
from mbot_workstation.sim.pose import Pose
from mbot_workstation.virtual.live_world import WorldStatus
from mbot_workstation.virtual.trajectory import TrajectoryWriter


def line(x_m: float) -> bytes:
    place = {"t": 1, "unix_s": 2.5, "x": x_m, "y": 0.5, "yaw": 0.25, "object": [1.0, 2.0, 0.0]}
    return json.dumps(place).encode() + b"\n"


def test_half_a_line_is_read_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "path.jsonl"
    path.write_bytes(line(0.1) + b'{"t": 2, "event": "touch", "score": 1}\n' + line(0.2)[:20])
    file = PathFile(path)
    assert file.read() == [Place(2_500_000_000, (0.1, 0.5), 0.25, (1.0, 2.0))]
    assert file.read() == []
    with path.open("ab") as more:
        more.write(line(0.2)[20:])
    assert [place.robot for place in file.read()] == [(0.2, 0.5)]
    file.close()


@pytest.mark.parametrize(
    "wrong", [b"nonsense\n", b"[]\n", b'{"t": 1, "x": 1}\n', line(float("nan"))]
)
def test_what_is_no_path_is_one_line(tmp_path: Path, wrong: bytes) -> None:
    path = tmp_path / "path.jsonl"
    path.write_bytes(wrong)
    with pytest.raises(ConfigurationError, match=r"path\.jsonl"):
        PathFile(path).read()
    with pytest.raises(ConfigurationError, match="can't read the path"):
        PathFile(tmp_path / "none")


def test_what_the_virtual_robot_writes_can_be_read_at_once(tmp_path: Path) -> None:
    path = tmp_path / "path.jsonl"
    with TrajectoryWriter(path) as writer:
        pose, target = Pose(0.25, -0.5, 1.0), Pose(1.0, 1.5, 0.0)
        writer.add(WorldStatus(3.0, pose, (target,), Joystick(0, 0), (0.0, 0.0), {}, ended=False))
        (place,) = PathFile(path).read()
    assert (place.robot, place.yaw_rad, place.target) == ((0.25, -0.5), 1.0, (1.0, 1.5))
    assert place.unix_time_ns > 1_700_000_000 * 10**9


def test_who_is_carried_draws_no_line() -> None:
    path = DrivenPath()
    for x_m in (0.0, 0.1, 0.2, 1.0, 1.1):
        path.add(Place(0, (x_m, 0.0), 0.0, (0.0, 0.0)))
    assert path.strips == [[(0.0, 0.0), (0.1, 0.0), (0.2, 0.0)], [(1.0, 0.0), (1.1, 0.0)]]
    for _ in range(2 * LONGEST_PATH):
        path.add(Place(0, (1.1, 0.0), 0.0, (0.0, 0.0)))
    assert sum(map(len, path.strips)) == LONGEST_PATH


def test_a_map_grows_with_its_file(tmp_path: Path) -> None:
    class Viewer:
        def __init__(self) -> None:
            self.places: list[Place] = []
            self.paths: list[object] = []

        def log_place(self, robot: str, place: Place) -> None:
            assert robot == "mbot-1"
            self.places.append(place)

        def log_path(self, robot: str, time_ns: int, strips: Sequence[Sequence[Point]]) -> None:
            assert (robot, time_ns) == ("mbot-1", self.places[-1].unix_time_ns)
            self.paths.append(strips)

    viewer, path = Viewer(), tmp_path / "path.jsonl"
    path.write_bytes(line(0.1))
    one = MapLog(viewer, "mbot-1", path)
    one.log_new()
    one.log_new()
    assert (len(viewer.places), viewer.paths) == (1, [[[(0.1, 0.5)]]])
    with path.open("ab") as more:
        more.write(line(0.2) + line(0.3))
    one.log_all()
    assert len(viewer.places) == 3
    assert viewer.paths[-1] == [[(0.1, 0.5), (0.2, 0.5), (0.3, 0.5)]]
    one.close()
