from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mbot_protocol.drive.actions import MotorMap, Steps, WheelMaps
from mbot_protocol.drive.calibration import (
    CAMERA_FILE,
    MOTION_FILE,
    MotorMappings,
    read_camera,
    read_motor_mappings,
)
from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera
from mbot_protocol.drive.lens import folds_within
from mbot_protocol.drive.wheel_command import Duties
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.toml_file import read_toml

CAMERA_TEXT = """
width_px = 2028
height_px = 1520
focal_x_px = 1936.5
focal_y_px = 1934
principal_x_px = 1020.25
principal_y_px = 751.0
distortion = [-0.11, 0.05, 0.0005, -0.0003, 0.0]
reprojection_error_px = 0.31
pictures = 21
made_on = "2026-11-21"
"""

MOTION_TEXT = """
free_speed_rpm = 118.0
wheel_radius_m = 0.0319
track_m = 0.117
wheel_friction = 0.85
load_loss = 0.03
latency_ms = 31.0
made_on = "2026-11-21"
[left_motor]
gain = 1.05
dead_band = 52.5
time_constant_ms = 95.0
trim = 0.9
dead_band_compensation = 45
[right_motor]
gain = 0.95
dead_band = 47
time_constant_ms = 105.0
trim = 1.0
dead_band_compensation = 40
[intervals."left_motor.gain"]
low = 1.04
high = 1.06
[undetermined]
free_speed_rpm = "scales with both gains"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / CAMERA_FILE).write_text(CAMERA_TEXT)
    (tmp_path / MOTION_FILE).write_text(MOTION_TEXT)
    return tmp_path


def test_a_camera_is_read(folder: Path) -> None:
    camera = read_camera(folder)
    assert camera is not None
    assert camera.model() == CameraModel(
        2028, 1520, 1936.5, 1934.0, 1020.25, 751.0, (-0.11, 0.05, 0.0005, -0.0003, 0.0)
    )


def test_what_is_missing_is_none_but_a_missing_folder_is_a_mistake(tmp_path: Path) -> None:
    assert read_camera(tmp_path) is None
    assert read_motor_mappings(tmp_path) is None
    with pytest.raises(ConfigurationError, match=r"no calibration folder .*nowhere"):
        read_camera(tmp_path / "nowhere")
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="no calibration folder"):
        read_motor_mappings(tmp_path / "file")


CAMERA_MISTAKES = [
    ("focal_x_px = 1936.5", "focal_x_px = 6.0", "focal_x_px is 6.0, expected 272 to 11590"),
    ("focal_y_px = 1934", "focal_y_px = nan", "focal_y_px is nan"),
    (
        "focal_y_px = 1934",
        "focal_y_px = '1934'",
        "focal_y_px is '1934' (line 5)",
    ),
    ("principal_x_px = 1020.25", "principal_x_px = 3000.0", "principal_x_px is 3000.0"),
    ("principal_x_px = 1020.25\n", "", "principal_x_px is missing"),
    ("width_px = 2028", "width_px = 3", "width_px is 3, expected 16 to 8192"),
    ("[-0.11, 0.05, ", "[-0.11, ", "distortion has 4 numbers, expected 5"),
    ("[-0.11, 0.05, ", "[-0.11, inf, ", "distortion is inf"),
    ("[-0.11, 0.05, ", "[-1.9, 0.05, ", "does not fold over the part"),
    ("pictures = 21", "pictures = 0", "pictures is 0"),
    ('"2026-11-21"', '"21.11.2026"', "made_on is '21.11.2026', expected a date"),
    ("pictures = 21", "pictures = 21\nskew = 1", "skew is unknown"),
    ("pictures = 21", "pictures =", "not valid TOML"),
]


@pytest.mark.parametrize(("old", "new", "words"), CAMERA_MISTAKES)
def test_a_mistake_names_file_key_and_value_in_one_line(
    folder: Path, old: str, new: str, words: str
) -> None:
    path = folder / CAMERA_FILE
    assert CAMERA_TEXT.count(old) == 1
    path.write_text(CAMERA_TEXT.replace(old, new))
    with pytest.raises(ConfigurationError) as caught:
        read_camera(folder)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert words in message
    assert "\n" not in message


def test_of_the_motion_the_daemon_reads_how_to_drive_the_motors_only(folder: Path) -> None:
    path = folder / MOTION_FILE
    newer = MOTION_TEXT.replace("gain = 1.05", "gain = 1.05\nof_a_later_release = 3.0")
    path.write_text(newer.replace("load_loss = 0.03", "another = 'x'"))
    read = read_motor_mappings(folder)
    assert read is not None
    assert read.wheel_maps() == WheelMaps(MotorMap(True, 0.9, 45), MotorMap(False, 1.0, 40))
    assert read.wheel_maps().duties(Steps(250, 250)) == Duties(230 / 255, 1.0)


MOTION_MISTAKES = [
    ("trim = 0.9", "trim = 1.2", "left_motor: trim is 1.2"),
    ("trim = 0.9", "trim = nan", "left_motor: trim is nan"),
    ("trim = 0.9", "trimm = 0.9", "left_motor.trim is missing; add it to [left_motor] (line 9)"),
    ("trim = 0.9", "trim = 0.17", "dead_band_compensation is 45, expected below 255 x trim"),
    ("[right_motor]", "[rihgt_motor]", "right_motor is missing"),
]


@pytest.mark.parametrize(("old", "new", "words"), MOTION_MISTAKES)
def test_a_mistake_in_the_motion_names_its_side(
    folder: Path, old: str, new: str, words: str
) -> None:
    assert MOTION_TEXT.count(old) == 1
    (folder / MOTION_FILE).write_text(MOTION_TEXT.replace(old, new))
    with pytest.raises(ConfigurationError) as caught:
        read_motor_mappings(folder)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_no_file_is_so_broken_that_it_is_no_clear_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / MOTION_FILE
    path.write_bytes(content)
    with pytest.raises(ConfigurationError) as caught:
        read_toml(path, MotorMappings)
    assert str(path) in str(caught.value)


def test_a_file_that_may_not_be_read_is_one_line(tmp_path: Path) -> None:
    (tmp_path / CAMERA_FILE).mkdir()
    with pytest.raises(ConfigurationError, match=r"can't read .*camera\.toml: Is a directory"):
        read_camera(tmp_path)


@given(st.floats(-0.6, 0.6), st.floats(-0.4, 0.4), st.floats(-0.3, 0.3))
def test_a_lens_folds_where_two_rays_meet_in_one_pixel(k1: float, k2: float, k3: float) -> None:
    """Against OpenCV: along the diagonal the picture's radius must rise up to the corner."""
    bent = CameraModel(640, 480, 400.0, 400.0, 319.5, 239.5, (k1, k2, 0.0, 0.0, k3))
    slopes = np.linspace(0, 5.6, 2000)
    rays = np.stack([slopes * 0.8, slopes * 0.6, np.ones(len(slopes))], axis=1)
    pixels, _ = cv2.projectPoints(
        rays, np.zeros(3), np.zeros(3), bent.matrix, np.array(bent.distortion)
    )
    radius_px = np.asarray(pixels).reshape(-1, 2)[:, 0] - 319.5
    beyond = np.flatnonzero(radius_px >= 320.0 * 1.02)
    clear = len(beyond) > 0 and bool((np.diff(radius_px[: beyond[0] + 1]) > 0).all())
    before = np.flatnonzero(radius_px >= 320.0 * 0.98)
    hopeless = len(before) == 0 or bool((np.diff(radius_px[: before[0] + 1]) < 0).any())
    if clear:
        assert not folds_within(bent)
    if hopeless:
        assert folds_within(bent)


def test_a_straight_lens_never_folds() -> None:
    assert not folds_within(nominal_pi_camera(320, 240))
