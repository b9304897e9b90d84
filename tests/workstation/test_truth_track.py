"""The virtual robot's truth, written as a tracker on it would."""

import threading
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.track_cleaning import noise
from mbot_workstation.measure.tracks.track_file import read_track
from mbot_workstation.measure.tracks.track_format import PRESETS
from mbot_workstation.sim.simulation import SceneState
from mbot_workstation.virtual.scene_history import SceneHistory
from mbot_workstation.virtual.truth_track import FRAME_YAW_RAD, TrackerSettings, TruthTrack

NO_NOISE = TrackerSettings(position_noise_m=0, angle_noise_rad=0)


def write(path: Path, settings: TrackerSettings, count: int = 400) -> None:
    """Turning to the left on a circle of 0.5 m, once around."""
    with TruthTrack(path, settings) as track:
        for row, yaw in enumerate(np.linspace(0, 2 * np.pi, count)):
            place = np.array([0.5 * np.sin(yaw), 0.5 - 0.5 * np.cos(yaw), 0.0])
            turn = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
            track.add(1e6 + row / 90, place, turn)


def test_both_formats_tell_the_same_path(tmp_path: Path) -> None:
    for name in ("a.csv", "a.tum"):
        write(tmp_path / name, NO_NOISE)
    csv = read_track(tmp_path / "a.csv", PRESETS["triad-openvr"])
    tum = read_track(tmp_path / "a.tum")
    assert np.allclose(csv.position_m, tum.position_m, atol=1e-5)
    assert np.abs(np.sum(csv.quaternion_wxyz * tum.quaternion_wxyz, axis=1)).min() > 1 - 1e-9
    assert tum.yaw_rad[-1] == pytest.approx(2 * np.pi, abs=1e-3)
    assert np.allclose(tum.position_m[:, 2], 0.12, atol=1e-6)
    radius = np.linalg.norm(tum.position_m[:, :2] - tum.position_m[:-1, :2].mean(axis=0), axis=1)
    assert np.allclose(radius, 0.5, atol=0.002)


def test_the_tracker_sits_where_it_is_said_to_sit(tmp_path: Path) -> None:
    settings = TrackerSettings(0, 0, ahead_m=0.03, left_m=0.1)
    write(tmp_path / "a.tum", settings)
    track = read_track(tmp_path / "a.tum")
    radius = np.linalg.norm(
        track.position_m[:, :2] - track.position_m[:-1, :2].mean(axis=0), axis=1
    )
    assert np.allclose(radius, np.hypot(0.5 - 0.1, 0.03), atol=0.002)


@pytest.mark.parametrize(
    ("axis", "column"), [((0, 0, 1), "yaw"), ((1, 0, 0), "pitch"), ((0, -1, 0), "roll")]
)
def test_the_angles_for_people_are_those_of_openvr(
    tmp_path: Path, axis: tuple[int, int, int], column: str
) -> None:
    """About y, which is up there, x to the right, and z backwards."""
    path = tmp_path / "a.csv"
    with TruthTrack(path, NO_NOISE) as track:
        # Turned back by what the tracker turns the arena.
        back = Rotation.from_euler("z", -FRAME_YAW_RAD)
        wanted = back * Rotation.from_rotvec(np.radians(20) * np.array(axis))
        track.add(0.0, np.zeros(3), wanted.as_quat(scalar_first=True))
    header, row = path.read_text().splitlines()
    seen = dict(zip(header.split(","), map(float, row.split(",")), strict=True))
    expected = dict.fromkeys(("yaw", "pitch", "roll"), 0.0) | {column: 20.0}
    assert {name: seen[name] for name in expected} == pytest.approx(expected, abs=1e-4)


def test_its_noise_is_as_large_as_it_is_said_to_be(tmp_path: Path) -> None:
    write(tmp_path / "a.csv", TrackerSettings(0.004, np.radians(0.3)), 2000)
    position_m, angle_rad = noise(read_track(tmp_path / "a.csv", PRESETS["triad-openvr"]))
    assert position_m == pytest.approx(0.004, rel=0.1)
    assert angle_rad == pytest.approx(np.radians(0.3), rel=0.1)


def state(x: float) -> SceneState:
    joints = np.array([x, 0, 0, 1, 0, 0, 0], dtype=np.float64)
    return SceneState(joints, np.zeros((2, 3)), np.zeros((2, 4)))


def test_the_history_gives_the_moments_around_a_time() -> None:
    history = SceneHistory(0.005)
    history.add(1.0, state(0))
    with pytest.raises(LookupError):
        history.around(1.0)
    for step in range(1, 5):
        history.add(1 + step / 100, state(step))
    for time_s, before in ((1.012, 1), (1.0, 0), (0.5, 0), (1.04, 3), (9.0, 3)):
        (first_s, first), (second_s, second) = history.around(time_s)
        assert (first.joints[0], second.joints[0]) == (before, before + 1)
        assert second_s > first_s


def test_poses_are_taken_between_two_steps_of_physics(tmp_path: Path) -> None:
    import time

    history, stop = SceneHistory(0.005), threading.Event()
    began_s = time.monotonic()
    history.add(began_s - 1, state(-1))
    history.add(began_s + 60, state(60))  # 1 m/s, in one long step
    with TruthTrack(tmp_path / "a.tum", NO_NOISE) as track:
        thread = threading.Thread(target=track.run, args=(history, stop))
        thread.start()
        time.sleep(0.5)
        stop.set()
        thread.join()
    found = read_track(tmp_path / "a.tum")
    moved = np.linalg.norm(found.position_m - found.position_m[0], axis=1)
    assert np.allclose(moved, found.time_s - found.time_s[0], atol=1e-4)
    assert np.allclose(np.diff(found.time_s) * 90, np.round(np.diff(found.time_s) * 90), atol=1e-3)


def test_an_unusable_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"expected .csv, .tum or .txt"):
        TruthTrack(tmp_path / "a.bag", NO_NOISE)
    with pytest.raises(ConfigurationError, match="can't write"):
        TruthTrack(tmp_path / "no" / "a.csv", NO_NOISE)
