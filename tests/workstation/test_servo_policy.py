import hashlib
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read when onnxruntime is imported

import cv2
import numpy as np
import onnx
import onnxruntime
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import (
    FULL_VIEW,
    INPUT_NAME,
    OBSERVATION_SIDE_PX,
    FieldOfView,
    PolicyMetadata,
)
from mbot_workstation.cli.demo import make_servo_policy
from mbot_workstation.cli.presenter import plain
from mbot_workstation.fleet.models.check import check_model
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
from mbot_workstation.fleet.models.written_policy import write_policy

from .called import output_of

GAINS = ServoGains()
SEARCH = (GAINS.search_speed, -GAINS.search_speed)
CAMERA = CameraModel.from_field_of_view(
    OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg
)
CAMERA_HEIGHT_M, PITCH_DEG, EDGE_M = 0.075, 5.0, 0.10
CUBE, FLOOR, WALL, ROOM = (200, 30, 35), (205, 200, 192), (205, 205, 203), (150, 140, 130)
OVERSAMPLING = 8

Policy = Callable[[Picture], NDArray[np.float64]]


def load(model: onnx.ModelProto) -> Policy:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )

    def act(picture: Picture) -> NDArray[np.float64]:
        (action,) = session.run(None, {INPUT_NAME: picture[None]})
        return np.asarray(action, np.float64)[0]

    return act


MODEL = servo_model(GAINS, PolicyMetadata("servo"))
POLICY = load(MODEL)


def row(elevation_deg: float, pitch_deg: float) -> float:
    down = np.tan(np.radians(-elevation_deg - pitch_deg))
    return float(CAMERA.principal_y_px + CAMERA.focal_y_px * down)


def scene(
    bearing_deg: float | None = None,
    distance_m: float = 1.0,
    pitch_deg: float = PITCH_DEG,
    floor: tuple[int, int, int] = FLOOR,
    room: tuple[int, int, int] = ROOM,
) -> Picture:
    """What the camera sees: room above a wall 3 m away, floor, and a cube as a flat front."""
    side = OBSERVATION_SIDE_PX * OVERSAMPLING
    picture = np.empty((side, side, 3), np.uint8)

    def at(px: float) -> int:
        return int(np.clip(round((px + 0.5) * OVERSAMPLING), 0, side))

    def elevation(height_m: float, away_m: float) -> float:
        return float(np.degrees(np.arctan2(height_m - CAMERA_HEIGHT_M, away_m)))

    wall_top, wall_foot = (at(row(elevation(height, 3.0), pitch_deg)) for height in (0.20, 0.0))
    picture[:wall_top], picture[wall_top:wall_foot], picture[wall_foot:] = room, WALL, floor
    if bearing_deg is not None:
        top, foot = (at(row(elevation(height, distance_m), pitch_deg)) for height in (EDGE_M, 0))
        middle = CAMERA.principal_x_px + CAMERA.focal_x_px * np.tan(np.radians(bearing_deg))
        half = CAMERA.focal_x_px * EDGE_M / 2 / distance_m
        picture[top:foot, at(middle - half) : at(middle + half)] = CUBE
    return np.asarray(cv2.resize(picture, (64, 64), interpolation=cv2.INTER_AREA), np.uint8)


def test_any_robot_takes_the_model(tmp_path: Path) -> None:
    path = tmp_path / "servo.onnx"
    path.write_bytes(MODEL.SerializeToString())
    metadata = check_model(path).metadata
    assert metadata == PolicyMetadata("servo", FULL_VIEW, 2.5)
    assert [opset.domain for opset in MODEL.opset_import] == [""]
    assert MODEL.opset_import[0].version <= 17
    assert MODEL.ir_version <= 10
    assert not {node.op_type for node in MODEL.graph.node} & {"Loop", "If", "Scan"}


def test_without_an_object_it_turns_clockwise() -> None:
    assert POLICY(scene()) == pytest.approx(SEARCH)


def test_object_ahead_is_driven_at_with_full_speed() -> None:
    for distance_m in (0.2, 0.5, 1.0, 2.0, 3.0, 4.0):
        assert POLICY(scene(0.0, distance_m)) == pytest.approx((1.0, 1.0), abs=0.02)


def test_object_that_fills_the_view_is_driven_into() -> None:
    red = np.full((64, 64, 3), CUBE, np.uint8)
    assert POLICY(red) == pytest.approx((1.0, 1.0), abs=0.02)


@given(
    bearing_deg=st.floats(2.0, 25.0),
    distance_m=st.floats(0.25, 4.0),
    pitch_deg=st.floats(3.5, 6.5),
)
def test_it_turns_towards_the_object_and_drives(
    bearing_deg: float, distance_m: float, pitch_deg: float
) -> None:
    left, right = POLICY(scene(bearing_deg, distance_m, pitch_deg))
    assert left > right
    assert left + right > 0
    left, right = POLICY(scene(-bearing_deg, distance_m, pitch_deg))
    assert left < right
    assert left + right > 0


@given(bearing_deg=st.floats(-20.0, 20.0), distance_m=st.floats(0.4, 3.0))
def test_a_decision_does_not_turn_far_beyond_the_object(
    bearing_deg: float, distance_m: float
) -> None:
    left, right = POLICY(scene(bearing_deg, distance_m))
    full_speed_m_s, track_m, decision_s = 0.41, 0.115, 0.4
    turned_deg = np.degrees((left - right) * full_speed_m_s / track_m * decision_s)
    assert abs(turned_deg) <= 2.5 * abs(bearing_deg) + 1.0


@given(
    bearing_deg=st.floats(-22.0, 22.0),
    distance_m=st.floats(0.3, 3.0),
    exposure=st.floats(0.4, 1.2),
    tint=st.sampled_from([(1.0, 1.0, 1.0), (1.12, 1.0, 0.8), (0.88, 1.0, 0.95), (0.88, 1.0, 1.14)]),
)
def test_light_hardly_changes_the_action(
    bearing_deg: float, distance_m: float, exposure: float, tint: tuple[float, float, float]
) -> None:
    picture = scene(bearing_deg, distance_m)
    lit = np.clip(picture * (exposure * np.array(tint)), 0, 255).astype(np.uint8)
    assert POLICY(lit) == pytest.approx(POLICY(picture), abs=0.06)


@pytest.mark.parametrize("tint", [(1.0, 1.0, 1.0), (1.2, 1.0, 0.75), (0.88, 1.0, 1.14)])
@pytest.mark.parametrize(
    "floor", [FLOOR, (190, 140, 95), (190, 150, 140), (190, 120, 115), (40, 40, 40)]
)
def test_floors_and_lights_are_no_object(
    floor: tuple[int, int, int], tint: tuple[float, float, float]
) -> None:
    lit = np.clip(scene(floor=floor) * np.array(tint), 0, 255).astype(np.uint8)
    assert POLICY(lit) == pytest.approx(SEARCH)


def test_red_things_above_the_wall_are_no_object() -> None:
    assert POLICY(scene(room=CUBE)) == pytest.approx(SEARCH)
    left, right = POLICY(scene(-15.0, room=(160, 60, 40)))
    assert left < right


def test_noise_is_no_object() -> None:
    rng = np.random.default_rng(1)
    for floor in (FLOOR, (40, 40, 40)):
        noisy = scene(floor=floor) + rng.normal(0, 6, (64, 64, 3))
        assert POLICY(np.clip(noisy, 0, 255).astype(np.uint8)) == pytest.approx(SEARCH)


@pytest.mark.parametrize(
    "colour", [(0, 0, 0), (255, 255, 255), (255, 0, 0), (1, 0, 0), (0, 255, 0), (0, 0, 255)]
)
def test_plain_pictures_give_an_action(colour: tuple[int, int, int]) -> None:
    action = POLICY(np.full((64, 64, 3), colour, np.uint8))
    assert np.isfinite(action).all()
    assert (np.abs(action) <= 1).all()


@given(hnp.arrays(np.uint8, (64, 64, 3)))
def test_any_picture_gives_an_action(picture: Picture) -> None:
    action = POLICY(picture)
    assert np.isfinite(action).all()
    assert (np.abs(action) <= 1).all()


def test_another_view_is_another_scale_of_bearings() -> None:
    narrow = load(servo_model(GAINS, PolicyMetadata("servo", FieldOfView(30.0, 42.9))))
    picture = scene(15.0)
    assert np.subtract(*narrow(picture)) < np.subtract(*POLICY(picture))


run = partial(output_of, make_servo_policy)


def test_command_writes_the_model(tmp_path: Path) -> None:
    path = tmp_path / "servo.onnx"
    told = json.loads(run(str(path), "--search-speed", "0.1", "--json"))
    data = path.read_bytes()
    assert told == {
        "path": str(path),
        "name": "servo",
        "sha256": hashlib.sha256(data).hexdigest(),
        "size_bytes": len(data),
    }
    assert load(onnx.load_from_string(data))(scene()) == pytest.approx((0.1, -0.1))


def test_command_tells_digest_and_what_is_next(tmp_path: Path) -> None:
    path = tmp_path / "servo.onnx"
    output = run(str(path))
    assert hashlib.sha256(path.read_bytes()).hexdigest()[:12] in output
    assert f"push-model {path}" in output


def test_a_written_policy_says_what_it_is(tmp_path: Path) -> None:
    model = servo_model(ServoGains(), PolicyMetadata("servo"))
    made = write_policy(tmp_path / "a.onnx", "servo", model)
    assert made.sha256 == hashlib.sha256(made.path.read_bytes()).hexdigest()
    assert made.size_bytes == made.path.stat().st_size
    assert plain(made).keys() == {"path", "name", "sha256", "size_bytes"}
    trained = write_policy(tmp_path / "b.onnx", "servo", model, checkpoint=tmp_path)
    assert plain(trained)["checkpoint"] == str(tmp_path)


def test_same_options_give_the_same_file(tmp_path: Path) -> None:
    for name in ("one.onnx", "two.onnx"):
        run(str(tmp_path / name))
    assert (tmp_path / "one.onnx").read_bytes() == (tmp_path / "two.onnx").read_bytes()


def test_command_names_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="can't write"):
        run(str(tmp_path / "missing" / "servo.onnx"))
    with pytest.raises(ConfigurationError, match="--view"):
        run(str(tmp_path / "servo.onnx"), "--view", "200", "40")
