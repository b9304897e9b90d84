"""The parts of the identification, each by itself."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.actions import WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.identification.binning import Binning
from mbot_workstation.identification.first_guess import FirstGuess, first_guess
from mbot_workstation.identification.flat_track import flatten
from mbot_workstation.identification.held_out import is_held_out
from mbot_workstation.identification.linearisation import Linearisation
from mbot_workstation.identification.manoeuvres import Manoeuvres
from mbot_workstation.identification.parameters import (
    BY_NAME,
    NAMES,
    PARAMETERS,
    value,
    with_values,
)
from mbot_workstation.identification.preparation import prepare
from mbot_workstation.identification.run_simulation import (
    simulate_paths,
    simulate_run,
    wheel_volts,
)
from mbot_workstation.identification.run_slopes import slopes
from mbot_workstation.identification.run_terms import OWN, SETTING
from mbot_workstation.identification.run_view import RunView, simulate_views
from mbot_workstation.identification.selection import select
from mbot_workstation.identification.steady_motion import held_commands, onset_s
from mbot_workstation.recordings.run import CommandSeries, Recording, Run
from mbot_workstation.recordings.track import Array, Track
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.room_generator import generate_room
from mbot_workstation.simulation.simulation import Simulation

from .planar_robot import PlanarRobot, Session, Tracker, record

TRUTH = PlanarRobot()
ROBOT = with_values(RobotParameters(), {"mass_ahead_m": 0.004, "dry_friction": 0.05})
MAPS = WheelMaps()


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record(TRUTH, Session().shortened(2.5, 1), seed=4)


@pytest.fixture(scope="module")
def views(recording: Recording) -> tuple[RunView, ...]:
    return prepare([recording], RobotParameters()).views


def guess(recording: Recording) -> FirstGuess:
    runs = flatten(recording)
    return first_guess(runs, RobotParameters(), recording.wheel_maps, recording.tracker_ahead_s)


def run_of(*rows: tuple[float, float, float]) -> Run:
    table = np.array(rows)
    still = Track(np.array([0.0, 1.0]), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)))
    return Run(1, "", 1, CommandSeries(*table.T), still)


# The simulation


def test_a_run_is_simulated_as_the_virtual_robot_drives_it() -> None:
    pieces = ((1.0, 0.4), (-0.3, 1.0), (0.0, -1.0), (1.0, 1.0))
    rows = [(3.0 + 0.6 * i, *piece) for i, piece in enumerate(pieces)]
    track = simulate_run(ROBOT, run_of(*rows, (3.0 + 0.6 * 4, 0, 0)), MAPS)
    robot = Simulation(ROBOT, room_picture=generate_room(seed=0, width_px=64))
    robot.step(0.2)
    begin = robot.pose
    for left, right in pieces:
        robot.set_duty(*((40 + 215 * abs(a)) / 255 * np.sign(a) for a in (left, right)))
        robot.step(0.6)
    at_end = int(np.argmin(np.abs(track.time_s - 5.4)))
    assert track.time_s[0] == 3.0
    way = robot.pose.x_m - begin.x_m, robot.pose.y_m - begin.y_m
    assert track.position_m[at_end, :2] == pytest.approx(way, abs=4e-3)
    turned = track.yaw_rad[at_end] - robot.pose.yaw_rad
    assert np.cos(turned) == pytest.approx(1, abs=1e-4)


def test_a_change_within_a_step_counts_in_part() -> None:
    commands = run_of((0.0, 1, 0), (0.012, 0, 1), (0.031, 0, 0)).commands
    volts = wheel_volts(RobotParameters(), commands, MAPS, 8)
    np.testing.assert_allclose(volts[:, 0], 3.7 * np.array([1, 1, 0.4, 0, 0, 0, 0, 0]), atol=1e-9)
    np.testing.assert_allclose(volts[:, 1], 3.7 * np.array([0, 0, 0.6, 1, 1, 1, 0.2, 0]), atol=1e-9)


def test_dry_friction_holds_a_standing_wheel_and_leaves_speeds_alone() -> None:
    commands = run_of((0.0, 1, 0), (3.0, 0, 0))
    speeds, turns = [], []
    for dry in (0.0, 0.1):
        robot = with_values(RobotParameters(), {"dry_friction": dry})
        turns.append(simulate_run(robot, commands, MAPS).yaw_rad[600])
        straight = simulate_run(robot, run_of((0.0, 1, 1), (3.0, 0, 0)), MAPS)
        speeds.append(straight.position_m[600, 0])
    assert speeds[1] == pytest.approx(speeds[0], rel=0.003)
    # The body's centrifugal force drags a wheel that is not held forward.
    assert abs(turns[1]) > 1.02 * abs(turns[0])


def test_drag_in_turns_slows_turns_alone_and_a_weak_motor_more() -> None:
    dragging = with_values(RobotParameters(), {"turning_drag_n_m": 0.01})

    def kept(commands: Run, gain: float = 1.0) -> float:
        easy, hard = (
            simulate_run(with_values(robot, {"right_gain": gain}), commands, MAPS)
            for robot in (RobotParameters(), dragging)
        )
        if commands.commands.left[0] == commands.commands.right[0]:
            return float(hard.position_m[400, 0] / easy.position_m[400, 0])
        return float(hard.yaw_rad[400] / easy.yaw_rad[400])

    straight, by_one = run_of((0.0, 1, 1), (2.0, 0, 0)), run_of((0.0, 0, 1), (2.0, 0, 0))
    assert kept(straight) == pytest.approx(1, abs=1e-3)
    assert 0.9 < kept(by_one) < 0.98
    assert 1 - kept(by_one, gain=0.5) == pytest.approx(2 * (1 - kept(by_one)), rel=0.3)


def test_mass_and_inertia_can_be_given_apart_from_the_bodies() -> None:
    slow = with_values(RobotParameters(), {"inertia_scale": 2.0})
    spin, straight = run_of((0.0, -1, 1), (1.0, 0, 0)), run_of((0.0, 1, 1), (1.0, 0, 0))
    nominal = RobotParameters()
    assert (
        simulate_run(slow, spin, MAPS).yaw_rad[30]
        < 0.8 * (simulate_run(nominal, spin, MAPS).yaw_rad[30])
    )
    assert simulate_run(slow, straight, MAPS).position_m[30, 0] == pytest.approx(
        simulate_run(nominal, straight, MAPS).position_m[30, 0], rel=0.02
    )
    same = with_values(nominal, {"mass_ahead_m": nominal.centre_of_mass_m})
    np.testing.assert_allclose(
        simulate_run(same, spin, MAPS).position_m,
        simulate_run(nominal, spin, MAPS).position_m,
        atol=1e-6,
    )


# Parameters


@pytest.mark.parametrize("name", NAMES)
def test_a_parameter_is_put_where_it_is_read(name: str) -> None:
    known = BY_NAME[name]
    changed = with_values(RobotParameters(), {name: value(RobotParameters(), name) + known.spread})
    assert value(changed, name) == pytest.approx(value(RobotParameters(), name) + known.spread)
    others = [other.name for other in PARAMETERS if other.name != name]
    for other in others:
        assert value(changed, other) == pytest.approx(value(RobotParameters(), other))


@given(st.sampled_from(NAMES), st.floats(-1e6, 1e6))
def test_no_parameter_leaves_its_limits(name: str, wanted: float) -> None:
    found = value(with_values(RobotParameters(), {name: wanted}), name)
    assert BY_NAME[name].low <= found <= BY_NAME[name].high


# Tracks on the floor


def test_the_floor_becomes_level_and_the_mount_does_not_matter() -> None:
    calm = Tracker(floor_deg=(3.0, -2.0), mount_deg=(25.0, 20.0, -30.0), wrong=0.0)
    leaning = record(TRUTH, Session().shortened(2.5, 1), calm, seed=4)
    for run, flat in zip(leaning.runs, flatten(leaning), strict=True):
        commands = run.commands
        true_rad = TRUTH.steady(float(commands.left[0]), float(commands.right[0]))[1] * 1.5
        since = flat.time_s - 5.03 - commands.start_s
        begin, end = np.argmin(np.abs(since - 0.9)), np.argmin(np.abs(since - 2.4))
        assert flat.heading[end] - flat.heading[begin] == pytest.approx(true_rad, abs=0.15)


def test_a_floor_that_stands_upright_is_refused(recording: Recording) -> None:
    tilt = np.array([[1, 0, 0], [0, 0.7, -0.7], [0, 0.7, 0.7]])
    runs = tuple(
        replace(run, track=replace(run.track, position_m=run.track.position_m @ tilt.T))
        for run in recording.runs
    )
    with pytest.raises(ConfigurationError, match=r"the tracked floor leans by 4. degrees"):
        flatten(replace(recording, runs=runs))


def test_single_far_samples_do_not_count() -> None:
    rng = np.random.default_rng(0)
    time_s = np.sort(rng.uniform(0, 5, 500))
    values = rng.normal(0, 0.004, (2, 500))
    values[:, 70] += 1.0
    binning = Binning(time_s)
    weights, deviation = binning.weigh(values)
    assert deviation == pytest.approx(0.004, rel=0.2)
    assert weights[70] < 1e-3
    means = binning.sums(values * weights) / binning.sums(weights)
    assert np.abs(means).max() < 0.015


def test_the_onset_is_found_and_not_made_up(recording: Recording) -> None:
    flat = flatten(recording)[0]
    began = onset_s(flat)
    assert began is not None
    assert began - flat.run.commands.start_s == pytest.approx(5.03 + 0.12, abs=0.06)
    late = replace(flat.run, track=_after(flat.run.track, began + 0.3))
    assert onset_s(flatten(replace(recording, runs=(late,)))[0]) is None


def test_equal_rows_are_one_piece() -> None:
    commands = run_of((0.0, 1, 0), (1.0, 1, 0), (2.0, 0, 1), (3.0, 0, 0)).commands
    assert held_commands(commands) == [(0.0, 2.0, 1.0, 0.0), (2.0, 3.0, 0.0, 1.0)]


# The first guess, and what it refuses


def test_kinematics_give_wheels_track_and_tracker(recording: Recording) -> None:
    found = guess(recording)
    assert found.left_m_s == pytest.approx(0.41, abs=0.02)
    assert found.right_m_s == pytest.approx(0.385, abs=0.02)
    assert found.track_m == pytest.approx(TRUTH.track, rel=0.05)
    assert (found.tracker.real, found.tracker.imag) == pytest.approx((-0.035, 0.012), abs=0.004)
    assert not found.stray


def test_without_turns_the_known_track_is_used(recording: Recording) -> None:
    straight = [run for run in recording.runs if run.maneuver == "forward-forward"]
    found = guess(replace(recording, runs=tuple(straight)))
    assert found.track_m is None
    assert found.left_m_s == pytest.approx(0.41, abs=0.03)


def _mirrored(track: Track) -> Track:
    return replace(
        track,
        position_m=track.position_m * (1, -1, 1),
        quaternion_wxyz=track.quaternion_wxyz * (1, -1, 1, -1),
    )


def _half_mirrored(track: Track) -> Track:
    return replace(track, position_m=track.position_m * (1, -1, 1))


def _in_millimetres(track: Track) -> Track:
    return replace(track, position_m=1000 * track.position_m)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_mirrored, "turns the other way than it was told"),
        (_half_mirrored, "place turns the other way than the tracked attitude"),
    ],
)
def test_tracks_that_cannot_be_are_refused(
    recording: Recording, spoil: Callable[[Track], Track], message: str
) -> None:
    runs = tuple(replace(run, track=spoil(run.track)) for run in recording.runs)
    with pytest.raises(ConfigurationError, match=message):
        guess(replace(recording, runs=runs))


def test_another_unit_is_named(recording: Recording) -> None:
    straight = [_steady_track(run) for run in recording.runs if "neutral" not in run.maneuver]
    guess(replace(recording, runs=tuple(straight)))
    runs = tuple(replace(run, track=_in_millimetres(run.track)) for run in straight)
    with pytest.raises(ConfigurationError, match="m/s at full command, expected about 0"):
        guess(replace(recording, runs=runs))


def _steady_track(run: Run) -> Run:
    """What a tracker without noise would see of an ideal robot."""
    commands = run.commands
    time_s = commands.start_s + np.arange(-0.7, 2.4, 0.011)
    left, right = 0.4 * float(commands.left[0]), 0.4 * float(commands.right[0])
    driven = np.maximum(time_s - commands.start_s, 0)
    yaw, way = (right - left) / 0.115 * driven, (left + right) / 2 * driven
    position = np.stack([way, 0 * way, 0 * way], axis=1)
    half = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)], axis=1)
    return replace(run, track=Track(time_s + 5.0, position, half))


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        ("right", "left", "left and right are swapped"),
        ("-left", "right", "the left motor runs against its commands"),
        ("left", "-right", "the right motor runs against its commands"),
    ],
)
def test_swapped_and_reversed_motors_are_named(
    recording: Recording, left: str, right: str, message: str
) -> None:
    def told(commands: CommandSeries) -> CommandSeries:
        sides = {"left": commands.left, "right": commands.right}
        sides |= {f"-{side}": -values for side, values in sides.items()}
        return CommandSeries(commands.time_s, sides[left], sides[right])

    runs = tuple(replace(run, commands=told(run.commands)) for run in recording.runs)
    with pytest.raises(ConfigurationError, match=message):
        guess(replace(recording, runs=runs))


# Slopes


def test_slopes_are_those_of_the_residual(recording: Recording) -> None:
    """Against central differences of the whole way from unknown to measurement."""
    rng = np.random.default_rng(1)
    names = ("left_gain", "left_time_constant_s", "track_m", "mass_ahead_m")
    prepared = prepare([recording], RobotParameters())
    view = next(v for v in prepared.views if v.flat.run.maneuver == "forward-backward")
    setting, deviation = prepared.fixed.guess[0], rng.normal(0, 1e-3, view.deviations)

    def measured(robot: RobotParameters, where: Array, start: Array, own: Array) -> Array:
        (path,) = simulate_views([view], [robot], [own])
        return view.residual(path, where, start, own).value

    (path,) = simulate_views([view], [ROBOT], [deviation])
    pose = view.begin(path, setting)
    (twists,) = Manoeuvres([view]).twists(ROBOT, names)
    residual = view.residual(path, setting, pose, deviation)
    found = slopes(view, path, twists, residual, setting, pose, deviation)
    assert found.common.shape == (len(names) + len(SETTING), 3, residual.value.shape[1])

    def check(slope: Array, change: Callable[[float], Array], step: float, exact: float) -> None:
        wanted = -(change(step) - change(-step)) / (2 * step)
        size = np.abs(wanted).max(axis=1, keepdims=True) + 1e-9
        # All but some bins, in which a sample's weight changes as well.
        assert np.quantile(np.abs((slope - wanted) / size), 0.9) < exact

    for row, name in enumerate(names):
        step = 0.02 * BY_NAME[name].spread
        here = value(ROBOT, name)
        check(
            found.common[row],
            lambda d, name=name, here=here: measured(
                with_values(ROBOT, {name: here + d}), setting, pose, deviation
            ),
            step,
            0.1,
        )
    for row in range(len(SETTING)):
        unit = np.eye(len(SETTING))[row]
        check(
            found.common[len(names) + row],
            lambda d, unit=unit: measured(ROBOT, setting + d * unit, pose, deviation),
            1e-3 if row != 1 else 1e-5,
            0.1,
        )
    for row in range(3):
        unit = np.eye(3)[row]
        check(
            found.pose[row],
            lambda d, unit=unit: measured(ROBOT, setting, pose + d * unit, deviation),
            1e-4,
            0.1,
        )
    for row in range(len(OWN)):
        unit = np.eye(view.deviations)[row]
        check(
            found.own[row],
            lambda d, unit=unit: measured(ROBOT, setting, pose, deviation + d * unit),
            1e-3,
            0.1,
        )
    in_first_second = np.eye(view.deviations)[len(OWN)]
    check(
        found.own[len(OWN)],
        lambda d: measured(ROBOT, setting, pose, deviation + d * in_first_second),
        1e-3,
        0.2,  # a piece's end is smeared over a time constant
    )


def test_a_manoeuvre_is_simulated_once(views: tuple[RunView, ...]) -> None:
    twice = [*views, *views]
    twists = Manoeuvres(twice).twists(ROBOT, ("track_m",))
    assert len(twists) == len(twice)
    assert len({id(one) for one in twists}) == 8
    assert all(a is b for a, b in zip(twists[:8], twists[8:], strict=True))


# What can be told


def _information(columns: Array) -> Linearisation:
    names = ("left_gain", "right_gain", "track_m", "wheel_radius_m")
    spreads = np.array([BY_NAME[name].spread for name in names])
    scaled = columns / spreads
    return Linearisation(names, np.ones(4, bool), scaled.T @ scaled, np.zeros(4), (), ())


def test_singular_values_decide_what_is_fitted() -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(0, 5, (40, 4))
    everything = select(_information(columns), _information(columns).names)
    assert everything.names == ("left_gain", "right_gain", "track_m", "wheel_radius_m")
    assert not everything.undetermined
    columns[:, 3] = columns[:, 0] + columns[:, 1]
    columns[:, 2] *= 1e-4
    some = select(_information(columns), _information(columns).names)
    assert some.names == ("left_gain", "right_gain")
    assert len(some.singular_values) == 2
    assert some.undetermined["track_m"] == "it changes nothing in these runs"
    assert "left motor gain" in some.undetermined["wheel_radius_m"]
    assert "right motor gain" in some.undetermined["wheel_radius_m"]
    columns[:, 2] *= 400
    weak = select(_information(columns), _information(columns).names)
    assert "too little" in weak.undetermined["track_m"]


def test_what_is_far_from_usual_is_not_put_back() -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(0, 5, (40, 4))
    columns[:, 2] *= 0.05
    everything = _information(columns)
    assert "track_m" in select(everything, everything.names).undetermined
    near, far = (
        select(everything, everything.names, {"track_m": spreads * BY_NAME["track_m"].spread})
        for spreads in (-1.0, -4.0)
    )
    assert "track_m" in near.undetermined
    assert "track_m" not in far.undetermined
    assert set(far.names) == set(everything.names)


# Halves


def test_every_other_repetition_is_held_out() -> None:
    recording = record(TRUTH, Session().shortened(1.8, 3), seed=2)
    views = prepare([recording], RobotParameters()).views
    held = is_held_out(views)
    for name in {view.flat.run.maneuver for view in views}:
        mine = [
            out for view, out in zip(views, held, strict=True) if view.flat.run.maneuver == name
        ]
        assert mine == [False, True, False]


def test_many_robots_at_once_are_each_alone() -> None:
    robots = [RobotParameters(), with_values(RobotParameters(), {"left_gain": 0.9})] * 3
    volts = np.random.default_rng(0).uniform(-3.7, 3.7, (6, 200, 2))
    together = simulate_paths(robots, volts)
    for robot, told, path in zip(robots, volts, together, strict=True):
        np.testing.assert_array_equal(simulate_paths([robot], told[None])[0], path)


def _after(track: Track, begin_s: float) -> Track:
    rest = track.between(begin_s, float(track.time_s[-1]))
    assert rest is not None
    return rest
