"""The parts of the identification, each by itself."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.identification.arrowhead import Arrowhead
from mbot_workstation.measure.identification.conclusions import steady_rate
from mbot_workstation.measure.identification.dataset import prepare
from mbot_workstation.measure.identification.floor import flatten
from mbot_workstation.measure.identification.initial_guess import (
    KinematicGuess,
    clocks,
    kinematic_guess,
)
from mbot_workstation.measure.identification.observed_run import Bins, bins_of, observe
from mbot_workstation.measure.identification.outliers import outlying_runs
from mbot_workstation.measure.identification.prediction import (
    NUISANCE,
    SETTING,
    Noise,
    Whitener,
    jacobians,
    predicted,
)
from mbot_workstation.measure.identification.rollout import (
    Plan,
    plans_of,
    rollouts,
    simulate_paths,
    simulate_run,
    step_count,
    wheel_volts,
)
from mbot_workstation.measure.identification.solver import (
    Problem,
    Solution,
    Solver,
    State,
    VarianceComponents,
    initial_state,
)
from mbot_workstation.measure.identification.validation import is_held_out
from mbot_workstation.measure.identification.variance_components import (
    common_and_individual,
    estimate_noise,
)
from mbot_workstation.measure.tracks.run import CommandSeries, ManeuverRecording, Run
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.sim.body.parameter_table import (
    BY_NAME,
    NAMES,
    PARAMETERS,
    usual,
    value,
    with_values,
)
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation

from .planar_robot import PlanarRobot, Session, Tracker, record

TRUTH = PlanarRobot()
ROBOT = with_values(
    RobotParameters(),
    {"mass_ahead_m": 0.004, "left_dry_friction": 0.05, "right_dry_friction": 0.05},
)
MAPS = WheelMaps()


@pytest.fixture(scope="module")
def recording() -> ManeuverRecording:
    return record(TRUTH, Session().shortened(2.5, 1), seed=4)


def guess(recording: ManeuverRecording) -> KinematicGuess:
    runs = flatten(recording)
    ahead_s, excluded = clocks(runs, recording.tracker_ahead_s)
    assert not excluded
    own_clock = recording.tracker_ahead_s is None
    seen = [
        observe(r, float(a), (0.0, 0.0), own_clock=own_clock)
        for r, a in zip(runs, ahead_s, strict=True)
    ]
    return kinematic_guess(seen, RobotParameters(), recording.wheel_maps)


def run_of(*rows: tuple[float, float, float]) -> Run:
    table = np.array(rows)
    still = Track(np.array([0.0, 1.0]), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)))
    return Run(1, "", 1, CommandSeries(*table.T), still)


def both(robot: RobotParameters, dry: float) -> RobotParameters:
    return with_values(robot, {"left_dry_friction": dry, "right_dry_friction": dry})


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


def test_what_both_motors_draw_makes_the_voltage_sag() -> None:
    robot = RobotParameters(battery_sag=0.1)
    alone = run_of((0.0, 1, 0), (1.0, 0, 0)).commands
    together = run_of((0.0, 1, -1), (1.0, 0, 0)).commands
    assert wheel_volts(robot, alone, MAPS, 1)[0] == pytest.approx((3.7 * 0.95, 0))
    assert wheel_volts(robot, together, MAPS, 1)[0] == pytest.approx((3.7 * 0.9, -3.7 * 0.9))


def test_a_bent_motor_is_as_fast_at_full_duty_and_faster_before() -> None:
    bent = with_values(RobotParameters(), {"left_bend": 0.8, "right_bend": 0.8})
    full, part = (run_of((0.0, told, told), (2.0, 0, 0)) for told in (1.0, 0.3))
    ways = [
        [simulate_run(robot, run, MAPS).position_m[400, 0] for run in (full, part)]
        for robot in (RobotParameters(), bent)
    ]
    assert ways[1][0] == pytest.approx(ways[0][0], rel=1e-6)
    assert ways[1][1] > 1.15 * ways[0][1]


def test_dry_friction_holds_a_standing_wheel_and_leaves_speeds_alone() -> None:
    commands = run_of((0.0, 1, 0), (3.0, 0, 0))
    speeds, turns = [], []
    for dry in (0.0, 0.1):
        robot = both(RobotParameters(), dry)
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
    assert 1 - kept(by_one, gain=0.5) > 1.1 * (1 - kept(by_one))


def test_rolling_drag_slows_driving_and_keeps_an_uneven_spin_in_its_place() -> None:
    dragging = with_values(RobotParameters(), {"rolling_drag_n": 0.3, "mass_ahead_m": 0.0})
    free = with_values(RobotParameters(), {"mass_ahead_m": 0.0})
    straight, spin = run_of((0.0, 1, 1), (2.0, 0, 0)), run_of((0.0, -0.9, 1), (2.0, 0, 0))
    slow, fast = (simulate_run(robot, straight, MAPS) for robot in (dragging, free))
    # 0.3 N on both motors together, which lose 0.2 m/s and more for each newton.
    assert 0.9 < slow.position_m[400, 0] / fast.position_m[400, 0] < 0.97
    creeping, drifting = (simulate_run(robot, spin, MAPS) for robot in (dragging, free))
    rates = [np.ptp(path.position_m[300:400, :2], axis=0).max() for path in (creeping, drifting)]
    assert rates[0] < 0.5 * rates[1]
    assert creeping.yaw_rad[400] == pytest.approx(drifting.yaw_rad[400], rel=0.03)


def test_a_robot_that_drives_almost_straight_does_not_stick_to_its_heading() -> None:
    dragging = with_values(RobotParameters(), {"turning_drag_n_m": 0.02, "left_gain": 0.97})
    path = simulate_run(dragging, run_of((0.0, 1, 1), (3.0, 0, 0)), MAPS)
    assert path.yaw_rad[600] > 0.1


def test_a_battery_that_fades_weakens_both_motors() -> None:
    fresh = with_values(RobotParameters(), {"battery_fade": 0.1})
    straight = run_of((0.0, 1, 1), (3.0, 0, 0))
    new, old = (simulate_run(fresh.discharged(share), straight, MAPS) for share in (0.0, 1.0))
    assert old.position_m[600, 0] == pytest.approx(0.9 * new.position_m[600, 0], rel=0.02)


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


@pytest.mark.parametrize("told", [(1.0, 1.0), (0.0, 1.0), (-1.0, 1.0)])
def test_a_held_command_goes_on_as_it_would(told: tuple[float, float]) -> None:
    run = run_of((0.0, *told), (10.0, 0, 0))
    ((path,),) = rollouts([ROBOT], [Plan(run.commands, MAPS)])
    volts = wheel_volts(ROBOT, run.commands, MAPS, step_count(run.commands))
    whole = simulate_paths([ROBOT], volts[None])[0]
    np.testing.assert_allclose(path[:2000], whole[:2000], atol=1e-4)


def test_runs_that_were_told_the_same_are_simulated_once() -> None:
    runs = [run_of((at, 1, 0), (at + long, 0, 0)) for at, long in ((0.0, 10.0), (50.0, 10.01))]
    other = run_of((0.0, 1, 0), (1.0, 0, 1), (10.0, 0, 0))
    plans, which = plans_of([(run.commands, MAPS) for run in (*runs, other)])
    assert which == [0, 0, 1]
    assert plans[0].commands is runs[1].commands


def test_many_robots_at_once_are_each_alone() -> None:
    robots = [RobotParameters(), with_values(RobotParameters(), {"left_gain": 0.9})] * 3
    volts = np.random.default_rng(0).uniform(-3.7, 3.7, (6, 200, 2))
    together = simulate_paths(robots, volts)
    for robot, told, path in zip(robots, volts, together, strict=True):
        np.testing.assert_array_equal(simulate_paths([robot], told[None])[0], path)


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


@pytest.mark.parametrize("known", PARAMETERS, ids=lambda known: known.name)
def test_usual_values_and_nominal_ones_are_within_the_limits(known: object) -> None:
    one = BY_NAME[getattr(known, "name", "")]
    for number in (usual(RobotParameters(), one.name), value(RobotParameters(), one.name)):
        assert one.low <= number <= one.high
    assert one.spread > 0
    assert one.source


# Tracks on the floor


@pytest.mark.slow
def test_the_floor_becomes_level_and_the_mount_does_not_matter() -> None:
    calm = Tracker(floor_deg=(3.0, -2.0), mount_deg=(25.0, 20.0, -30.0), wrong=0.0)
    leaning = record(TRUTH, Session().shortened(2.5, 1), calm, seed=4)
    for run, flat in zip(leaning.runs, flatten(leaning), strict=True):
        commands = run.commands
        true_rad = TRUTH.steady(float(commands.left[0]), float(commands.right[0]))[1] * 1.5
        since = flat.time_s - 5.03 - commands.start_s
        begin, end = np.argmin(np.abs(since - 0.9)), np.argmin(np.abs(since - 2.4))
        assert flat.heading[end] - flat.heading[begin] == pytest.approx(true_rad, abs=0.15)


def test_a_floor_that_stands_upright_is_refused(recording: ManeuverRecording) -> None:
    tilt = np.array([[1, 0, 0], [0, 0.7, -0.7], [0, 0.7, 0.7]])
    runs = tuple(
        replace(run, track=replace(run.track, position_m=run.track.position_m @ tilt.T))
        for run in recording.runs
    )
    with pytest.raises(ConfigurationError, match=r"the tracked floor leans by 4. degrees"):
        flatten(replace(recording, runs=runs))


# Increments


@given(
    st.floats(-np.pi, np.pi), st.floats(-3, 3), st.floats(-3, 3), st.floats(-8, 8), st.floats(0, 1)
)
def test_increments_know_nothing_of_where_a_run_began(
    turn: float, x: float, y: float, rate: float, speed: float
) -> None:
    time_s = np.linspace(0, 2, 181)
    heading = rate * time_s
    place = np.cumsum(speed / 90 * np.exp(1j * heading))
    bins: Bins = bins_of(time_s)
    moved = place * np.exp(1j * turn) + complex(x, y)
    np.testing.assert_allclose(
        bins.increments(np.asarray(moved, np.complex128), heading + turn),
        bins.increments(np.asarray(place, np.complex128), heading),
        atol=1e-9,
    )


def test_the_onset_is_found_and_not_made_up(recording: ManeuverRecording) -> None:
    ahead_s, excluded = clocks(flatten(replace(recording, tracker_ahead_s=None)), None)
    assert not excluded
    np.testing.assert_allclose(ahead_s, 5.03, atol=0.08)
    moving = [
        replace(run, track=_after(run.track, float(ahead) + run.commands.start_s + lead_s))
        for run, ahead, lead_s in zip(recording.runs, ahead_s, (-0.25, 0.5) * 4, strict=True)
    ]
    _, late = clocks(flatten(replace(recording, runs=tuple(moving))), None)
    assert set(late) == {1, 3, 5, 7}


# The first guess, and what it refuses


def test_kinematics_give_wheels_track_and_tracker(recording: ManeuverRecording) -> None:
    found = guess(recording)
    assert found.left_m_s == pytest.approx(0.41, abs=0.03)
    assert found.right_m_s == pytest.approx(0.385, abs=0.03)
    assert found.track_m == pytest.approx(TRUTH.track, rel=0.07)
    assert (found.tracker.real, found.tracker.imag) == pytest.approx((-0.035, 0.012), abs=0.005)
    assert not found.excluded


def test_without_turns_the_known_track_is_used(recording: ManeuverRecording) -> None:
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
    recording: ManeuverRecording, spoil: Callable[[Track], Track], message: str
) -> None:
    runs = tuple(replace(run, track=spoil(run.track)) for run in recording.runs)
    with pytest.raises(ConfigurationError, match=message):
        guess(replace(recording, runs=runs))


def test_another_unit_is_named(recording: ManeuverRecording) -> None:
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
    recording: ManeuverRecording, left: str, right: str, message: str
) -> None:
    def told(commands: CommandSeries) -> CommandSeries:
        sides = {"left": commands.left, "right": commands.right}
        sides |= {f"-{side}": -values for side, values in sides.items()}
        return CommandSeries(commands.time_s, sides[left], sides[right])

    runs = tuple(replace(run, commands=told(run.commands)) for run in recording.runs)
    with pytest.raises(ConfigurationError, match=message):
        guess(replace(recording, runs=runs))


# Prediction


def test_jacobians_are_those_of_the_prediction(recording: ManeuverRecording) -> None:
    """Against central differences."""
    data = prepare([recording], RobotParameters())
    index = next(i for i, r in enumerate(data.runs) if r.maneuver == "forward-backward")
    problem = data.problem([index], ())
    run, setting = problem.runs[0], np.array([0.01, 1e-5, -0.03, 0.01, 0.4, 1e-5])
    ((path,),) = rollouts([ROBOT], problem.plans)
    found = jacobians(run, path, setting, 0.01, ROBOT.track_m)
    assert found.nuisance.shape == (len(NUISANCE), *run.seen.shape)
    steps = np.array([1e-3, 1e-4, 1e-4, 1e-4, 1e-4, 1e-6])
    for row, step in enumerate(steps):
        unit = np.eye(len(SETTING))[row] * step
        wanted = predicted(run, path, setting + unit, 0.01)
        wanted = (wanted - predicted(run, path, setting - unit, 0.01)) / (2 * step)
        scale = np.abs(wanted).max() + 1e-9
        assert np.abs(found.settings[row] - wanted).max() < 0.05 * scale, SETTING[row]
    later = predicted(run, path, setting, 0.011) - predicted(run, path, setting, 0.009)
    assert np.abs(found.nuisance[3] - later / 0.002).max() < 0.1 * np.abs(later / 0.002).max()


def test_a_stronger_motor_moves_its_wheel_alone(recording: ManeuverRecording) -> None:
    data = prepare([recording], RobotParameters())
    index = next(i for i, r in enumerate(data.runs) if r.maneuver == "forward-forward")
    problem = data.problem([index], ())
    run, setting = problem.runs[0], np.zeros(len(SETTING))
    stronger = with_values(ROBOT, {"left_gain": 1.02})
    (mine,), (more,) = rollouts([ROBOT, stronger], problem.plans)
    change = predicted(run, more, setting, 0.0) - predicted(run, mine, setting, 0.0)
    expected = 0.02 * jacobians(run, mine, setting, 0.0, ROBOT.track_m).nuisance[0]
    steady = slice(run.seen.shape[1] // 2, None)
    assert change[2, steady].sum() == pytest.approx(expected[2, steady].sum(), rel=0.05)
    assert change[0, steady].sum() == pytest.approx(expected[0, steady].sum(), rel=0.05)


def test_whitened_noise_is_white(recording: ManeuverRecording) -> None:
    rng = np.random.default_rng(0)
    run = prepare([recording], RobotParameters()).runs[0]
    noise = Noise(0.004, 0.005, 0.002, 0.003)
    still = np.zeros_like(run.sample_s)
    rows: list[Array] = []
    for _ in range(200):
        place = rng.normal(0, noise.place_m, still.size) + 1j * rng.normal(
            0, noise.place_m, still.size
        )
        walk = np.cumsum(
            rng.normal(0, 1, still.size) * np.sqrt(np.diff(run.sample_s, prepend=run.sample_s[0]))
        )
        heading = rng.normal(0, noise.heading_rad, still.size) + noise.heading_walk * walk
        seen = run.bins.increments(place * np.exp(1j * 0), heading)
        rows.append(Whitener(run, noise).whiten(seen)[2])
    covariance = np.cov(np.array(rows).T)
    assert np.diag(covariance).mean() == pytest.approx(1, abs=0.15)
    assert abs(np.diag(covariance, 1).mean()) < 0.1


# The solver


@pytest.fixture(scope="module")
def solved() -> tuple[Problem, State, Solution]:
    """Two wheels' gains and the track, of a robot that differs in nothing else."""
    truth = with_values(RobotParameters(), {"left_gain": 0.93, "track_m": 0.118})
    session = Session().shortened(2.5, 2)
    from .mujoco_truth import record_simulated

    data = prepare([record_simulated(truth, session, Tracker(drift=0.0), seed=1)], truth)
    problem = data.problem(range(len(data.runs)), ("left_gain", "right_gain", "track_m"))
    state = initial_state(problem, with_values(RobotParameters(), data.guessed))
    return problem, state, Solver(problem, VarianceComponents(), data.noise()).solve(state, 3)


def test_the_solver_finds_what_made_the_runs(solved: tuple[Problem, State, Solution]) -> None:
    problem, _, solution = solved
    robot = solution.state.robot
    assert robot.left_motor.gain == pytest.approx(0.93, rel=0.006)
    assert robot.right_motor.gain == pytest.approx(1.0, rel=0.006)
    assert robot.track_m == pytest.approx(0.118, abs=0.0007)
    assert solution.covariance.shape == (3, 3)
    off = (robot.track_m - 0.118) / BY_NAME["track_m"].spread
    assert abs(off) < 3 * np.sqrt(solution.covariance[2, 2])
    settings = solution.state.settings[0]
    assert settings[2:4] == pytest.approx((-0.035, 0.012), abs=0.001)
    assert not outlying_runs(problem, solution)


def test_noise_is_learnt_from_what_is_left(solved: tuple[Problem, State, Solution]) -> None:
    problem, _, solution = solved
    (noise,) = estimate_noise(problem.runs, solution, [Noise(0.001, 0.001, 0.001, 0.001)])
    assert noise.place_m == pytest.approx(0.004, rel=0.25)
    assert noise.heading_rad == pytest.approx(np.radians(0.3), rel=0.25)


def test_more_scatter_makes_less_certain(solved: tuple[Problem, State, Solution]) -> None:
    problem, _, solution = solved
    noise = [Noise(0.004, 0.005, 0.001, 0.003)]
    calm, wild = (
        Solver(problem, VarianceComponents(misfit=misfit), noise).evaluate(solution.state)
        for misfit in (0.002, 0.03)
    )
    assert (np.diag(wild.covariance) > 2 * np.diag(calm.covariance))[:2].all()


def test_an_arrow_explains_what_all_its_columns_would() -> None:
    rng = np.random.default_rng(2)
    runs = [(rng.normal(size=(n, 3)), rng.normal(size=(n, 2))) for n in (12, 9, 20)]
    prior = np.diag([3.0, 5.0])
    arrow = Arrowhead.of(runs, prior)
    rows = sum(len(own) for own, _ in runs)
    columns = np.zeros((rows + 2, 2 + 3 * len(runs)))
    columns[:, :2] = np.vstack([*[shared for _, shared in runs], prior])
    for place, (block, (own, _)) in enumerate(zip(arrow.blocks, runs, strict=True)):
        columns[block.rows, 2 + 3 * place : 5 + 3 * place] = own
    aim = rng.normal(size=rows + 2)
    expected, *_ = np.linalg.lstsq(columns, aim, rcond=None)
    shared, own = arrow.solve(aim)
    np.testing.assert_allclose(np.append(shared, own), expected, atol=1e-10)
    np.testing.assert_allclose(arrow.project_out(aim), aim - columns @ expected, atol=1e-10)
    np.testing.assert_allclose(arrow.project_out(columns), 0, atol=1e-10)


BOTH_OR_ONE = np.repeat(
    np.array([[True, True], [True, False], [False, True]]), (24, 12, 12), axis=0
)


def test_what_motors_have_in_common_never_takes_all_of_the_scatter() -> None:
    """Runs of both motors scatter by more than those of one, as a slippery floor makes them.

    The mean product of both motors' deviations is then beyond their mean square. Who subtracts
    them finds no scatter of single motors; the next fit makes both wheels of each run deviate
    alike, however they turned, and finds that confirmed.
    """
    alike, unlike = np.tile([0.03, -0.03], 12), np.tile([0.008, 0.008, -0.008, -0.008], 6)
    off = np.where(BOTH_OR_ONE, np.tile([[0.012], [-0.012]], (24, 1)), 0)
    off[:24] = np.stack([alike + unlike, alike - unlike], axis=1) / np.sqrt(2)
    assert (off[:24, 0] * off[:24, 1]).mean() > (off[BOTH_OR_ONE] ** 2).mean()
    battery, motor = common_and_individual(off, np.ones(48), BOTH_OR_ONE)
    assert motor == pytest.approx(0.008, abs=0.0015)
    assert battery == pytest.approx(0.018, abs=0.003)


@pytest.mark.parametrize("seed", range(3))
def test_scatter_in_common_is_told_from_that_of_each_motor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    off = (rng.normal(0, 0.01, (48, 1)) + rng.normal(0, 0.01, (48, 2))) * BOTH_OR_ONE
    battery, motor = common_and_individual(off, np.ones(48), BOTH_OR_ONE)
    assert 0.005 < motor < 0.016
    assert 0.002 < battery < 0.017


# Conclusions


def test_a_steady_rate_is_that_of_the_last_quarter_second() -> None:
    run = run_of((0.0, 1, 1), (2.0, 0, 0))
    path = np.zeros((521, 3))
    path[:, 2] = 0.005 * np.arange(521)  # 1 rad/s to the left, at 0.3 m/s
    path[:, 0], path[:, 1] = 0.3 * np.sin(path[:, 2]), 0.3 * (1 - np.cos(path[:, 2]))
    assert steady_rate(path, Plan(run.commands, MAPS)) == pytest.approx((0.3, 1.0), rel=1e-4)


# Halves


def test_every_other_repetition_is_held_out() -> None:
    recording = record(TRUTH, Session().shortened(1.8, 3), seed=2)
    runs = prepare([recording], RobotParameters()).runs
    held = is_held_out(runs)
    for name in {run.maneuver for run in runs}:
        mine = [out for run, out in zip(runs, held, strict=True) if run.maneuver == name]
        assert mine == [False, True, False]


def _after(track: Track, begin_s: float) -> Track:
    rest = track.between(begin_s, float(track.time_s[-1]))
    assert rest is not None
    return rest
