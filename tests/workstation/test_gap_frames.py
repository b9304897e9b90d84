"""Frames with their places, and drawn: `gap_report.frames`, `gap_report.simulated_view`."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.measure.gap_report.frames import read_frames, telemetry_frames
from mbot_workstation.measure.gap_report.simulated_view import FramePlace, RealFrame, frame_pairs
from mbot_workstation.measure.tracks.maneuver import maneuver_named
from mbot_workstation.measure.tracks.recording_folder import TELEMETRY_FILE
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.pose import ORIGIN, Pose

from .calibrations import LIGHT
from .gap_samples import compared_runs
from .samples import decision, picture


def test_a_frame_is_drawn_as_the_robot_would_see_it() -> None:
    cube = Pose(0.6, 0.0, 0.0)
    frame = RealFrame("x", np.zeros((120, 160, 3), np.uint8), FramePlace(ORIGIN, cube), False)
    observation = RealFrame("y", np.zeros((64, 64, 3), np.uint8), FramePlace(ORIGIN, cube), True)
    dark = CalibrationFiles(light=LIGHT)  # exposure 0.8
    first, second = frame_pairs([frame, observation], dark)
    assert first.calibrated.shape == first.nominal.shape == (120, 160, 3)
    assert second.calibrated.shape == (64, 64, 3)
    red = first.nominal.astype(int)
    assert (red[..., 0] - red[..., 1] > 80).any()  # the cube
    assert first.calibrated.mean() < 0.95 * first.nominal.mean()


def test_frames_are_read_with_their_places(tmp_path: Path) -> None:
    picture = np.zeros((30, 40, 3), np.uint8)
    picture[..., 2] = 200  # red, in OpenCV's order
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((900, 1280, 3), np.uint8))
    (tmp_path / "frames.csv").write_text(
        "file,x_m,y_m,yaw_deg,cube_x_m,cube_y_m,cube_yaw_deg\n"
        "a.png,0.5,-0.2,90,1,0,45\nb.png,0,0,0,,,\n"
    )
    first, second = read_frames(tmp_path)
    assert first.place == FramePlace(Pose(0.5, -0.2, math.pi / 2), Pose(1.0, 0.0, math.pi / 4))
    assert first.picture[0, 0].tolist() == [200, 0, 0]
    assert second.place.cube is None
    assert second.picture.shape == (450, 640, 3)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "can't read"),
        ("file,x,y\n", "has the columns"),
        ("file,x_m,y_m,yaw_deg\n", "names no picture"),
        ("file,x_m,y_m,yaw_deg\na.png,0,zero,0\n", "line 2: y_m is 'zero'"),
        ("file,x_m,y_m,yaw_deg\na.png,500,0,0\n", "line 2: x_m is 500"),
        ("file,x_m,y_m,yaw_deg\na.png,0,0,nan\n", "line 2: yaw_deg is nan"),
        ("file,x_m,y_m,yaw_deg\nmissing.png,0,0,0\n", "line 2: can't read"),
        ("file,x_m,y_m,yaw_deg\nframes.csv,0,0,0\n", "is not a picture"),
        ("file,x_m,y_m,yaw_deg,cube_x_m\na.png,0,0,0,1\n", "cube_y_m is ''"),
    ],
)
def test_unusable_frames_are_named(tmp_path: Path, content: str | None, message: str) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((30, 40, 3), np.uint8))
    if content is not None:
        (tmp_path / "frames.csv").write_text(content)
    with pytest.raises(ConfigurationError, match=message):
        read_frames(tmp_path)


def test_frames_of_the_first_run_are_found_in_telemetry(tmp_path: Path) -> None:
    (run,) = compared_runs([maneuver_named("forward-forward")], 1, duration_s=4.0)
    # Decisions from 100 s on, every 0.1 s; their pictures are 0.03 s older.
    with TelemetryFile(tmp_path / TELEMETRY_FILE, "mbot-1") as file:
        for number in range(80):
            one = decision(number)
            if number != 17:  # one picture got lost
                file.write(picture(one.unix_time_ns))
            file.write(one)
    frames = telemetry_frames(tmp_path, run, start_s=103.0)
    assert [frame.title for frame in frames] == [
        "before it starts",
        "1.4 s into forward-forward",
        "2.8 s into forward-forward",
    ]
    assert frames[0].place.robot == ORIGIN
    driven_s = 1.4 - 0.03
    where = frames[1].place.robot
    expected = [np.interp(driven_s, run.time_s, column) for column in run.measured.T]
    assert (where.x_m, where.y_m, where.yaw_rad) == pytest.approx(expected, abs=0.01)
    assert frames[0].picture[0, 0].tolist() == [255, 0, 0]
    assert telemetry_frames(tmp_path, run, start_s=500.0) == ()
    assert telemetry_frames(tmp_path / "none", run, start_s=103.0) == ()
