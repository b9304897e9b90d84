from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_workstation.learn.worlds.body_swap import swap_body
from mbot_workstation.learn.worlds.fast_physics import PLACEHOLDER
from mbot_workstation.sim.body.parameter_table import with_values
from mbot_workstation.sim.body.robot_mjcf import aim_camera
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EFFECT_NAMES, IDEAL, EffectRanges, RealWorldEffects
from mbot_workstation.sim.effects.perturbed_robot import (
    MOST_DEAD_BAND,
    observing_camera,
    perturbed_robot,
)
from mbot_workstation.sim.effects.presets import (
    KNOWN,
    NOMINAL,
    PERTURBATIONS,
    PRESETS,
    RANDOMISED,
    preset,
)
from mbot_workstation.sim.scene.scene_mjcf import build_model
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.simulation import Simulation


@given(st.integers(0, 2**32))
def test_draws_stay_in_their_ranges(seed: int) -> None:
    drawn = asdict(RANDOMISED.sample(np.random.default_rng(seed)))
    low, high = asdict(RANDOMISED.low), asdict(RANDOMISED.high)
    assert all(low[name] <= drawn[name] <= high[name] for name in EFFECT_NAMES)


def test_the_same_seed_draws_the_same_robot_and_another_one_another() -> None:
    draws = [RANDOMISED.sample(np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert draws[0] == draws[1] != draws[2]
    assert NOMINAL.sample(np.random.default_rng(1)) == NOMINAL.low == KNOWN


def test_randomisation_covers_what_was_measured() -> None:
    low, high, nominal = (asdict(e) for e in (RANDOMISED.low, RANDOMISED.high, KNOWN))
    left_out = {"jpeg_quality", "scene_variety"}
    outside = {n for n in EFFECT_NAMES if not low[n] <= nominal[n] <= high[n]} - left_out
    assert not outside


def test_a_perturbation_is_nominal_but_for_its_own_effects() -> None:
    for name, ranges in PERTURBATIONS.items():
        changed = {n for n in EFFECT_NAMES if getattr(ranges.low, n) != getattr(KNOWN, n)}
        most = {"automatic": 12, "any-room": 12, "light-held": 12, "home": 13}.get(name, 4)
        assert 1 <= len(changed) <= most, name
        assert ranges.is_fixed


def test_a_sharp_robot_never_blurs_and_is_otherwise_as_usual() -> None:
    sharp, usual = preset("sharp"), PRESETS["randomised"]
    assert sharp.high.exposure_ms == sharp.high.readout_ms == 0
    same = {"exposure_ms": (8.0, 30.0), "readout_ms": (15.0, 30.0)}
    assert sharp.changed(**same) == usual.changed(**same)
    assert "sharp" not in PRESETS, "no robot to be tried on"


def test_unknown_presets_are_refused_with_the_known_ones() -> None:
    assert all(preset(name) is ranges for name, ranges in PRESETS.items())
    with pytest.raises(ValueError, match=r"foggy.*nominal"):
        preset("foggy")


@pytest.mark.parametrize(
    "wrong",
    [
        {"left_gain": 0.0},
        {"exposure_ms": -1.0},
        {"camera_pitch_deg": float("nan")},
        {"battery_sag": 1.0},
        {"dead_band_scale": -0.1},
    ],
)
def test_impossible_effects_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        replace(IDEAL, **wrong)


def test_a_range_must_rise() -> None:
    with pytest.raises(ValueError, match="track_scale"):
        NOMINAL.changed(track_scale=(1.1, 0.9))


def test_no_effects_leave_body_mount_and_view_alone() -> None:
    robot = RobotParameters()
    same = perturbed_robot(robot, RealWorldEffects())
    assert (same.mass_kg, same.track_m, same.camera_mount) == pytest.approx(
        (robot.mass_kg, robot.track_m, robot.camera_mount)
    )
    view = observing_camera(IDEAL)
    whole = nominal_pi_camera(64, 64)
    assert (FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg) == (55.3, 42.9)
    assert view == whole


def test_no_dead_band_becomes_a_motor_that_never_turns() -> None:
    stiff = with_values(RobotParameters(), {"left_dead_band": 0.7})
    worse = perturbed_robot(stiff, replace(KNOWN, dead_band_scale=1.3))
    assert worse.left_motor.dead_band == MOST_DEAD_BAND
    assert worse.right_motor.dead_band == pytest.approx(1.3 * stiff.right_motor.dead_band)


def test_a_swapped_body_is_the_compiled_one_in_every_number() -> None:
    effects = RANDOMISED.sample(np.random.default_rng(3))
    robot = perturbed_robot(RobotParameters(turning_drag_n_m=0.01), effects)
    robot = replace(robot, camera=structs.replace(nominal_pi_camera(88, 72), principal_x_px=40.0))
    simulation = Simulation(room_picture=PLACEHOLDER)
    swap_body(simulation, robot)
    compiled = build_model(robot, SceneParameters(), PLACEHOLDER)
    differing = [
        name
        for name in dir(compiled)
        if isinstance(value := getattr(compiled, name), np.ndarray)
        and value.dtype.kind in "fi"
        and not np.allclose(value, getattr(simulation.model, name), atol=1e-9)
    ]
    # Where the light and the overhead camera are as seen from the robot's centre of mass, of use
    # only to cameras and lights that track it, which these do not; and bounding volumes.
    assert set(differing) <= {"light_poscom0", "cam_poscom0", "bvh_aabb"}
    assert simulation.model.stat.meaninertia == pytest.approx(compiled.stat.meaninertia)
    assert simulation.robot is robot


def test_an_aimed_camera_is_the_compiled_one() -> None:
    camera = structs.replace(nominal_pi_camera(64, 64), focal_x_px=50.0, principal_x_px=33.0)
    robot = replace(RobotParameters(), camera=nominal_pi_camera(64, 64))
    simulation = Simulation(robot, room_picture=PLACEHOLDER)
    aim_camera(simulation.model, camera)
    compiled = build_model(replace(robot, camera=camera), SceneParameters(), PLACEHOLDER)
    for name in ("cam_intrinsic", "cam_sensorsize", "cam_resolution"):
        assert np.allclose(getattr(simulation.model, name), getattr(compiled, name), rtol=1e-6)


def test_swapping_back_and_forth_leaves_nothing_behind() -> None:
    simulation, untouched = (Simulation(room_picture=PLACEHOLDER) for _ in range(2))
    swap_body(simulation, perturbed_robot(RobotParameters(), RANDOMISED.low))
    swap_body(simulation, RobotParameters())
    for robot in (simulation, untouched):
        robot.set_duty(1.0, 0.4)
        robot.step(1.0)
    assert simulation.pose == untouched.pose


def test_ranges_fix_and_widen_single_effects() -> None:
    ranges = EffectRanges.fixed(IDEAL).changed(noise=2.0, exposure_ms=(10.0, 20.0))
    assert (ranges.low.noise, ranges.high.noise) == (2.0, 2.0)
    assert (ranges.low.exposure_ms, ranges.high.exposure_ms) == (10.0, 20.0)
    assert not ranges.is_fixed
