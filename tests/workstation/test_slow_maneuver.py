"""The ninth maneuver: ramps that tell where wheels begin to turn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.identification.fit import identify
from mbot_workstation.measure.identification.motor_trim import trim_choice
from mbot_workstation.measure.identification.rollout import simulate_paths
from mbot_workstation.measure.maneuvers.plan import Order, plan, room_needed_m
from mbot_workstation.measure.tracks.commands_csv import CommandedRun, read_commands, write_commands
from mbot_workstation.measure.tracks.maneuver import BEAT_S, MANEUVERS, SLOW, maneuver_named
from mbot_workstation.measure.tracks.run import CommandSeries
from mbot_workstation.sim.body.motor import wheel_voltages
from mbot_workstation.sim.body.robot_parameters import RobotParameters

from .planar_robot import PlanarRobot, Schedule, Session, record

pytestmark = pytest.mark.timeout(600)
"""A fit with slow runs takes 20 s of two quiet cores, and minutes of busy ones."""

DUTIES = np.linspace(0.1, 0.35, 101)

BEGUN_RAD = 0.08
"""Turned in 1.5 s by a wheel that has begun to turn: 6 mm/s."""

BEATS = round(SLOW.duration_s(10.0) / BEAT_S)


def schedule() -> Schedule:
    return tuple((BEAT_S, *SLOW.told(beat * BEAT_S)) for beat in range(1, BEATS))


def test_each_wheel_ramps_alone_forward_and_backward() -> None:
    told = np.array([SLOW.told(beat * BEAT_S) for beat in range(BEATS + 10)])
    assert np.abs(told).max() == SLOW.left
    assert (told.min(axis=0) == -SLOW.left).all()
    assert not (told[:, 0] * told[:, 1]).any()
    assert np.abs(np.diff(told, axis=0)).max() <= 0.0081
    assert not told[0].any()
    assert not told[BEATS:].any()
    assert maneuver_named("slow") is SLOW
    assert MANEUVERS[0].told(3.0) == (MANEUVERS[0].left, MANEUVERS[0].right)
    assert MANEUVERS[0].duration_s(7.0) == 7.0


def test_it_is_planned_like_the_others() -> None:
    runs = plan([*MANEUVERS, SLOW], 2, Order.PAIRED)
    assert sum(run.maneuver is SLOW for run in runs) == 2
    assert max(room_needed_m(SLOW, 10.0)) < 1


def test_its_commands_are_kept_and_others_are_refused(tmp_path: Path) -> None:
    rows = schedule()
    series = CommandSeries(
        np.asarray(BEAT_S * np.arange(len(rows) + 1), np.float64),
        np.array([left for _, left, _ in rows] + [0.0]),
        np.array([right for _, _, right in rows] + [0.0]),
    )
    write_commands(tmp_path / "commands.csv", [CommandedRun(1, "slow", 1, series)])
    (run,) = read_commands(tmp_path / "commands.csv")
    np.testing.assert_allclose(run.commands.left, series.left)
    fast = replace(series, left=2 * series.left)
    write_commands(tmp_path / "fast.csv", [CommandedRun(1, "slow", 1, fast)])
    with pytest.raises(ConfigurationError, match=r"expected one wheel at a time, at most 0\.4"):
        read_commands(tmp_path / "fast.csv")


@pytest.mark.slow
def test_slow_runs_tell_dead_bands_to_5_of_255() -> None:
    truth = PlanarRobot()
    held = Session().shortened(3.0, 2)
    chosen = ("forward-forward", "backward-forward", "neutral-forward", "backward-neutral")
    schedules = {name: held.schedules[name] for name in chosen} | {"slow": schedule()}
    recording = record(truth, replace(held, schedules=schedules), seed=5)
    found = identify([recording], RobotParameters(), robot_id="slow")
    estimates = {one.name: one for one in found.estimates}
    for side, name in enumerate(("left_dead_band", "right_dead_band")):
        creeps, turns = (_starting_duty(truth, side, angle_rad) for angle_rad in (0.02, 0.15))
        assert creeps <= estimates[name].value <= turns
        low, high = estimates[name].low, estimates[name].high
        assert low is not None
        assert high is not None
        for sign in (1, -1):
            begins = _starting_duty(truth, side, BEGUN_RAD, sign)
            assert _simulated_starting_duty(found.robot, side, sign) == pytest.approx(
                begins, abs=5 / 255
            )
    maps = trim_choice(found, recording.wheel_maps).straight
    assert maps.left.dead_band == int(255 * estimates["left_dead_band"].value)
    assert maps.right.dead_band == int(255 * estimates["right_dead_band"].value)


def _starting_duty(truth: PlanarRobot, side: int, angle_rad: float, sign: int = 1) -> float:
    """The least duty at which one wheel, driven alone, turns the robot so far in 1.5 s.

    Its friction is like honey below 5 mm/s, so it creeps before it turns.
    """
    told = np.zeros((len(DUTIES), 3000, 2))
    told[:, :, side] = sign * DUTIES[:, None]
    turned = np.abs(truth.drive(told, np.ones_like(told))[0][:, -1, 2])
    return float(DUTIES[int(np.argmax(turned > angle_rad))])


def _simulated_starting_duty(robot: RobotParameters, side: int, sign: int) -> float:
    told = np.zeros((len(DUTIES), 2))
    told[:, side] = sign * DUTIES
    volts = np.array([[wheel_voltages(left, right, robot)] * 300 for left, right in told.tolist()])
    turned = np.abs(simulate_paths([robot] * len(DUTIES), volts)[:, -1, 2])
    return float(DUTIES[int(np.argmax(turned > BEGUN_RAD))])
