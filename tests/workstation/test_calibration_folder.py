import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Struct

from mbot_agent.configuration import Configuration
from mbot_agent.configuration_files import calibrated
from mbot_protocol.drive.actions import MotorMap
from mbot_protocol.drive.calibration import CameraCalibration, read_camera
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.drivers.contestants import driver
from mbot_workstation.learn.learning.run_directory import write_json
from mbot_workstation.learn.learning.training_config import TrainingConfig, read_config
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.body.parameter_table import OF_A_MOTOR, OF_THE_ROBOT, Parameter
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import (
    CalibrationFiles,
    files_to_simulate,
    read_calibration,
    read_files,
    write_body,
    write_camera,
    write_light,
    write_motion,
)
from mbot_workstation.sim.calibrated.motion_calibration import (
    Interval,
    MotionCalibration,
    MotorCalibration,
    read_motion,
)
from mbot_workstation.sim.calibrated.motion_ranges import NARROWINGS
from mbot_workstation.sim.calibrated.toml_writer import write_toml
from mbot_workstation.sim.effects.body_record import BODY_RECORD, body_record
from mbot_workstation.sim.effects.effects import EFFECT_NAMES, EffectRanges, RealWorldEffects
from mbot_workstation.sim.effects.perturbed_robot import (
    perturbed_robot,
    perturbed_wheel_maps,
)
from mbot_workstation.sim.effects.presets import KNOWN, PRESETS, preset
from mbot_workstation.sim.scene.scene_parameters import SceneParameters

from .calibrations import BODY, CAMERA, LIGHT, MOTION
from .small_world import ROOMS


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_camera(tmp_path / "mbot-1", CAMERA)
    write_motion(tmp_path / "mbot-1", MOTION)
    write_body(tmp_path / "mbot-1", BODY)
    write_light(tmp_path / "mbot-1", LIGHT)
    return tmp_path / "mbot-1"


def test_what_is_written_is_read_again(folder: Path) -> None:
    files = CalibrationFiles(str(folder), CAMERA, MOTION, BODY, LIGHT)
    assert read_files(folder) == files
    assert (read_camera(folder), read_motion(folder)) == (CAMERA, MOTION)
    assert sorted(path.name for path in folder.iterdir()) == [
        "body.toml",
        "camera.toml",
        "light.toml",
        "motion.toml",
    ]
    assert "size_m = [0.16, 0.08, 0.03]\n" in (folder / "body.toml").read_text()


def within_limits(known: Sequence[Parameter]) -> dict[str, st.SearchStrategy[float]]:
    return {
        one.file_key: st.floats(one.file_factor * one.low, one.file_factor * one.high)
        for one in known
    }


motors = st.builds(
    MotorCalibration,
    **within_limits(OF_A_MOTOR),
    trim=st.floats(0.8, 1),
    dead_band_compensation=st.integers(0, 200),
)
motions = st.builds(
    MotionCalibration,
    left_motor=motors,
    right_motor=motors,
    **within_limits(OF_THE_ROBOT),
    latency_ms=st.floats(0, 1000),
    made_on=st.dates().map(lambda day: day.isoformat()),
    intervals=st.dictionaries(
        st.text(max_size=20),
        st.tuples(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9)).map(
            lambda ends: Interval(min(ends), max(ends))
        ),
        max_size=4,
    ),
    undetermined=st.dictionaries(st.text(max_size=20), st.text(max_size=60), max_size=4),
)


@given(motions)
def test_every_motion_survives_the_file_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, motion: MotionCalibration
) -> None:
    folder = tmp_path_factory.getbasetemp() / "any"
    write_motion(folder, motion)
    assert read_motion(folder) == motion


class Broken(Struct):
    value: dict[str, object]


def test_a_write_that_fails_leaves_the_old_file(folder: Path) -> None:
    before = (folder / "camera.toml").read_bytes()
    with pytest.raises(TypeError):
        write_toml(folder / "camera.toml", Broken({"no TOML": object()}), "x")
    assert (folder / "camera.toml").read_bytes() == before
    with pytest.raises(ConfigurationError, match="can't write"):
        write_camera(folder / "camera.toml", CAMERA)  # a folder below a file


def test_an_empty_folder_is_the_nominal_robot(tmp_path: Path) -> None:
    calibration = read_calibration(tmp_path)
    assert calibration.robot == RobotParameters()
    assert calibration.scene == SceneParameters()
    assert calibration.effects == KNOWN
    assert calibration.rooms == ()


def test_a_folder_that_is_no_robots_is_not_simulated(folder: Path) -> None:
    assert files_to_simulate(folder) == read_files(folder)
    assert files_to_simulate(None) == CalibrationFiles()
    rooms = folder.parent / "only-rooms"
    (rooms / "rooms").mkdir(parents=True)
    with pytest.raises(ConfigurationError, match=r"has no body\.toml"):
        files_to_simulate(rooms)
    (rooms / "rooms" / "kitchen.jpg").touch()
    files_to_simulate(rooms)


def test_every_file_makes_the_robot_it_describes(folder: Path) -> None:
    calibration = read_calibration(folder)
    robot, effects = calibration.robot, calibration.effects
    assert robot.camera == CAMERA.model()
    assert [body.name for body in robot.bodies] == ["frame", "battery", "camera"]
    assert robot.mass_kg == pytest.approx(0.42 + 0.25 + 0.15 + 2 * 0.038)
    assert (robot.camera_mount.height_m, robot.camera_mount.pitch_down_deg) == (0.1, 7.0)
    assert (robot.track_m, robot.wheel_radius_m, robot.load_loss) == (0.117, 0.0319, 0.03)
    assert robot.left_motor.dead_band == pytest.approx(54 / 255)
    assert robot.right_motor.time_constant_s == pytest.approx(0.11)
    assert robot.wheel_maps.left == MotorMap(True, 0.9, 44)
    assert calibration.scene.light.ambient == 0.6
    assert (robot.left_motor.gain, robot.right_motor.gain) == (1.06, 0.94)
    assert (effects.action_latency_ms, effects.exposure_gain, effects.red_gain) == (35, 0.8, 1.1)
    known = {"action_latency_ms", "exposure_gain", "red_gain", "blue_gain"}
    assert {n for n in EFFECT_NAMES if getattr(effects, n) != getattr(KNOWN, n)} == known


def test_driving_knows_better_than_the_ruler(tmp_path: Path) -> None:
    write_body(tmp_path, msgspec.structs.replace(BODY, track_m=0.112, wheel_radius_m=0.031))
    assert read_calibration(tmp_path).robot.track_m == 0.112
    write_motion(tmp_path, MOTION)
    assert read_calibration(tmp_path).robot.track_m == 0.117
    assert read_calibration(tmp_path).robot.wheel_radius_m == 0.0319


def test_rooms_are_the_pictures_in_their_folder(folder: Path) -> None:
    (folder / "rooms").mkdir()
    for name in ("kitchen.jpg", "attic.PNG", "notes.txt"):
        (folder / "rooms" / name).touch()
    names = [path.name for path in read_calibration(folder).rooms]
    assert names == ["attic.PNG", "kitchen.jpg"]


def test_a_broken_file_is_named(folder: Path) -> None:
    (folder / "light.toml").write_text((folder / "light.toml").read_text().replace("-0.7", "0.7"))
    with pytest.raises(ConfigurationError, match=r"light\.toml: direction .* shines upwards"):
        read_calibration(folder)


def test_simulation_and_daemon_are_told_the_same(folder: Path) -> None:
    robot = read_calibration(folder).robot
    daemon = calibrated(
        Configuration("mbot-1", calibration="mbot-1"), folder.parent / "config.toml"
    )
    assert daemon.motors == robot.wheel_maps
    assert daemon.camera.model_at(320, 240) == robot.camera.scaled_to(320, 240)


def test_presets_are_centred_on_the_calibrated_robot(folder: Path) -> None:
    effects = read_calibration(folder).effects
    files = read_files(folder)
    assert files.ranges("nominal") == preset("nominal", effects)
    nominal, randomised = preset("nominal", effects), preset("randomised", effects)
    assert nominal.is_fixed
    assert nominal.low == effects
    usual = PRESETS["randomised"]
    for name in EFFECT_NAMES:
        low, high = getattr(randomised.low, name), getattr(randomised.high, name)
        if name not in ("jpeg_quality", "scene_variety"):  # randomised leaves their nominal out
            assert low <= getattr(effects, name) <= high, name
        if getattr(effects, name) == getattr(KNOWN, name):
            assert (low, high) == (getattr(usual.low, name), getattr(usual.high, name))
    ratio = usual.high.exposure_gain / usual.low.exposure_gain
    assert randomised.high.exposure_gain / randomised.low.exposure_gain == pytest.approx(ratio)
    weak = perturbed_robot(files.robot, preset("handicap", effects).low)
    assert weak.right_motor.gain == pytest.approx(0.94 * 0.5)
    with pytest.raises(ValueError, match="'ideal' is no real robot"):
        preset("ideal", effects)


def test_a_calibrated_lens_is_not_randomised_as_if_nobody_had_measured_it(folder: Path) -> None:
    files = read_files(folder)
    assert files.ranges("randomised").low.lens_k1 == -files.ranges("randomised").high.lens_k1
    (folder / "camera.toml").unlink()
    assert read_files(folder).ranges("randomised").low.lens_k1 == PRESETS["randomised"].low.lens_k1
    assert files.ranges("distorted").low.lens_k1 == PRESETS["distorted"].low.lens_k1
    assert TrainingConfig(calibration=files).ranges() == files.ranges("randomised")


def test_identified_motors_are_not_randomised_as_if_nobody_had_driven_them(folder: Path) -> None:
    usual = preset("randomised", read_files(folder).effects)
    known = {
        "left_motor.gain": Interval(1.055, 1.065),
        "right_motor.gain": Interval(0.90, 0.98),
        "left_motor.time_constant_ms": Interval(88.0, 92.0),
        "right_motor.time_constant_ms": Interval(108.0, 112.0),
        "left_motor.dead_band": Interval(53.0, 55.0),
        "track_m": Interval(0.1160, 0.1180),
    }
    write_motion(folder, msgspec.structs.replace(MOTION, intervals=known))
    found = read_files(folder).ranges("randomised")

    def ends(name: str, ranges: EffectRanges = found) -> tuple[float, float]:
        return getattr(ranges.low, name), getattr(ranges.high, name)

    assert ends("left_gain") == pytest.approx((0.96, 1.04))  # as far as gains wander
    # Three times an interval that is wide, though no wider than the preset.
    reach = 3 * 0.04 / 0.94
    assert ends("right_gain") == pytest.approx((1 - reach, ends("right_gain", usual)[1]))
    assert ends("speed_scale") == pytest.approx((1 - reach, ends("speed_scale", usual)[1]))
    assert ends("time_constant_scale") == pytest.approx((0.85, 1.15))
    assert ends("track_scale") == pytest.approx((1 - 3 / 117, 1 + 3 / 117))
    # Of one motor only, and of none.
    for name in ("dead_band_scale", "wheel_radius_scale", "friction_scale"):
        assert ends(name) == ends(name, usual)
    assert read_files(folder).ranges("handicap") == preset("handicap", read_files(folder).effects)


@given(
    st.floats(0.06, 2.9),
    st.floats(0, 1),
    st.dictionaries(
        st.sampled_from([key for one in NARROWINGS for key in one.keys]),
        st.tuples(st.floats(-1, 300), st.floats(0, 500)).map(lambda i: Interval(i[0], i[0] + i[1])),
    ),
)
def test_ranges_only_ever_become_narrower_and_keep_the_robot(
    gain: float, share: float, intervals: dict[str, Interval]
) -> None:
    motor = msgspec.structs.replace(
        MOTION.left_motor, gain=gain, dead_band=178 * share, time_constant_ms=6 + 990 * share
    )
    motion = msgspec.structs.replace(MOTION, left_motor=motor, intervals=intervals)
    files = CalibrationFiles(motion=motion)
    usual, found = preset("randomised", files.effects), files.ranges("randomised")
    for name in EFFECT_NAMES:
        low, high = getattr(found.low, name), getattr(found.high, name)
        assert getattr(usual.low, name) <= low <= high <= getattr(usual.high, name)
        if any(one.effect == name for one in NARROWINGS):
            assert low <= getattr(files.effects, name) <= high


def test_a_shifted_range_never_leaves_what_can_be() -> None:
    randomised = preset("randomised", replace(KNOWN, action_latency_ms=0.0))
    assert randomised.low.action_latency_ms == 0
    assert randomised.high.action_latency_ms > 0


def test_the_wheels_keep_their_differences_under_effects(folder: Path) -> None:
    robot = read_calibration(folder).robot
    same = perturbed_robot(robot, read_calibration(folder).effects)
    for side in ("left_motor", "right_motor"):
        one, other = getattr(same, side), getattr(robot, side)
        assert one == other
    slower = perturbed_robot(robot, replace(KNOWN, time_constant_scale=2.0))
    ratio = slower.left_motor.time_constant_s / slower.right_motor.time_constant_s
    assert ratio == pytest.approx(90 / 110)
    maps = perturbed_wheel_maps(robot.wheel_maps, replace(KNOWN, compensation_scale=1.25))
    assert (maps.left.dead_band, maps.right.dead_band) == (55, 45)
    assert (maps.left.trim, maps.left.reversed, maps.right.reversed) == (0.9, True, False)


def test_a_motor_map_keeps_room_for_driving() -> None:
    weak = WEAK.wheel_maps()
    maps = perturbed_wheel_maps(weak, replace(KNOWN, compensation_scale=20.0))
    assert maps.left.duty(250) != 0
    assert maps.left.dead_band < 255 * 0.2


WEAK = msgspec.structs.replace(
    MOTION,
    left_motor=MotorCalibration(
        gain=1.0, dead_band=20.0, time_constant_ms=90.0, trim=0.2, dead_band_compensation=10
    ),
)


def test_a_calibrated_robot_is_trained_on_with_its_own_motor_maps(folder: Path) -> None:
    """A trim that makes up for uneven motors drives straight at full speed, without it a curve."""
    files = read_files(folder)
    curves: list[float] = []
    for maps in (files.robot.wheel_maps, RobotParameters().wheel_maps):
        robot = replace(files.robot, wheel_maps=maps)
        environment = TaskEnv(preset("nominal", files.effects), "10", ROOMS, robot, files.scene)
        environment.reset(seed=3)
        for _ in range(3):
            environment.step(np.ones(2, np.float32))
        curves.append(abs(environment.world.robot.yaw_rad))
        environment.close()
    assert curves[0] < 0.3 * curves[1]
    assert curves[1] > 0.2


def test_the_oracle_is_told_of_the_trim(folder: Path) -> None:
    robot, effects = read_calibration(folder).robot, preset("nominal")
    told = np.array(body_record(effects.low, robot), BODY_RECORD)
    assert told["left_gain"] == pytest.approx(1.06 * (255 * 0.9 - 54) / (255 - 54))
    assert told["right_gain"] == pytest.approx(0.94)
    assert (told["dead_band"], told["time_constant_ms"]) == pytest.approx((50, 100))
    assert told["dead_band_compensation"] == pytest.approx(40)
    even = RobotParameters()
    trimmed = replace(even, wheel_maps=robot.wheel_maps)
    infos = [{"aim_ahead_m": 1.0, "aim_left_m": 0.0}]
    plain = driver("oracle", 1, 0, effects).act(np.zeros((1, 64, 64, 3), np.uint8), infos)
    acted = driver("oracle", 1, 0, effects, trimmed).act(np.zeros((1, 64, 64, 3), np.uint8), infos)
    assert plain[0, 0] == pytest.approx(plain[0, 1])
    assert acted[0, 0] > acted[0, 1]  # the trimmed wheel has to be told more


def test_a_run_keeps_its_calibration_whatever_becomes_of_the_folder(
    folder: Path, tmp_path: Path
) -> None:
    config = TrainingConfig(preset="nominal", calibration=read_files(folder))
    write_json(tmp_path / "config.json", config.resolved())
    (folder / "motion.toml").unlink()
    again = read_config(tmp_path / "config.json")
    assert again == config
    assert again.robot.wheel_maps.left.trim == 0.9
    assert again.ranges().low == config.ranges().low
    resolved = json.loads((tmp_path / "config.json").read_text())
    assert resolved["effects"]["low"]["exposure_gain"] == 0.8
    assert resolved["training"]["calibration"]["camera"]["focal_x_px"] == 1990.0


def test_a_run_without_calibration_is_the_nominal_robots() -> None:
    config = TrainingConfig()
    assert config.ranges() is PRESETS["randomised"]
    assert config.robot == RobotParameters()
    with pytest.raises(ConfigurationError, match="ideal"):
        TrainingConfig(preset="ideal", calibration=CalibrationFiles())


@given(
    st.sampled_from(sorted(set(PRESETS) - {"ideal"})),
    st.floats(0.2, 2),
    st.floats(0, 500),
)
def test_any_robot_gives_usable_ranges(name: str, gain: float, latency_ms: float) -> None:
    effects = replace(KNOWN, action_latency_ms=latency_ms, exposure_gain=gain)
    ranges = preset(name, effects)
    drawn = ranges.sample(np.random.default_rng(0))
    assert isinstance(drawn, RealWorldEffects)
    assert math.isfinite(sum(getattr(drawn, effect) for effect in EFFECT_NAMES))


def test_the_light_of_the_calibration_is_drawn(folder: Path) -> None:
    """The walls turn darker or brighter with the light's direction, in training as well."""
    files = read_files(folder)
    pictures = []
    for scene in (SceneParameters(), files.scene):
        environment = TaskEnv("ideal", "10", ROOMS, scene=scene)
        observation, _ = environment.reset(seed=1)
        pictures.append(observation.astype(float))
        environment.close()
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.5


def test_an_old_picture_format_is_no_room(folder: Path) -> None:
    (folder / "rooms").mkdir()
    cv2.imwrite(str(folder / "rooms" / "room.bmp"), np.zeros((4, 8, 3), np.uint8))
    assert read_calibration(folder).rooms == ()


def test_files_can_be_made_without_a_folder() -> None:
    assert CalibrationFiles(camera=CAMERA).robot.camera == CameraCalibration.model(CAMERA)
