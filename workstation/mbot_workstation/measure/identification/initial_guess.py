"""Where the fit begins: clocks by the onset of motion, wheels and tracker by plain kinematics.

A robot whose wheels roll at speeds a (left) and b (right) turns at (b - a) / track. A tracker at
the place o on it (x + iy, from the axle's centre), turned by theta, moves in its own frame at
exp(-i theta) ((a + b) / 2 + i (b - a) / track o). Both are linear in a and b, hence in what the
motors are told, so steady driving gives everything in closed form. What no robot and no tracker
does is refused here.
"""

import cmath
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.actions import WheelMaps, to_steps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.identification.exclusion import Exclusion, Fault
from mbot_workstation.measure.identification.floor import FlatRun
from mbot_workstation.measure.identification.observed_run import ObservedRun, driving
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.motor import motor_voltage, pwm_duties
from mbot_workstation.sim.body.robot_parameters import RobotParameters

RESTING_S = 0.1
"""At a track's beginning, by which motion is told: nine samples."""

MOVED_M, TURNED_RAD = 0.02, 0.07
"""Beyond any noise of a resting tracker: 5 standard deviations of position, 13 of attitude."""

REACTION_S = 0.12
"""From the command to having moved so far, with wheels of 60 to 120 ms."""

MOVING_ACTION = 0.1
"""At which a wheel of any robot turns, slowly, with a daemon that skips most of its dead band."""

STRAY_S = 0.5
"""A run that begins to move this much earlier or later than the others was not driven as told."""

TELLING = 0.05
"""Of full voltage: less does not tell what a wheel does."""

MOST_STRAY = 0.3
"""Of full speed: a run in which a wheel is off by more was not driven as told."""

SLOWEST_M_S, FASTEST_M_S = 0.02, 3.0
"""Of such a robot's wheel; beyond, the unit of length or time is wrong."""

TURNS_AGAINST = (
    "the robot turns the other way than it was told, in all maneuvers that turn: left and right "
    "are swapped (the motors' plugs, or the columns left and right of commands.csv), both motors "
    "run backwards, or the tracker's frame is mirrored (handedness in track.toml)"
)


@dataclass(frozen=True, slots=True)
class KinematicGuess:
    """What one recording's steady driving says.

    Attributes:
        left_m_s, right_m_s: speed of each wheel at full voltage; None if no run drove it.
        track_m: None if it does not show.
        tracker: its place on the robot [m], x + iy ahead and to the left.
        tracker_yaw_rad: how far it is turned to the left on the robot.
        excluded: runs that were not driven as told, by their index, and why.

    """

    left_m_s: float | None
    right_m_s: float | None
    track_m: float | None
    tracker: complex
    tracker_yaw_rad: float
    excluded: dict[int, Exclusion]


def clocks(
    runs: Sequence[FlatRun], tracker_ahead_s: float | None
) -> tuple[Array, dict[int, Exclusion]]:
    """How far the tracker's clock is ahead of the robot's, by when the robot begins to move.

    Args:
        runs: of one recording.
        tracker_ahead_s: as the recording has it; None if each run has a clock of its own.

    Returns:
        For each run, with the wheels' delay in it, to 0.1 s, shape (runs,); and which runs can't
        be used, by index, and why.

    """
    onsets = np.array([_onset_s(run) for run in runs])
    ahead = onsets - np.array([_answered_s(run) for run in runs])
    known = np.isfinite(ahead)
    if tracker_ahead_s is None:
        why = "its track does not begin before the robot moves, so its clock can't be told"
        late = Exclusion(Fault.LATE_TRACK, why)
        return np.where(known, ahead, 0.0), {int(i): late for i in np.flatnonzero(~known)}
    # When a slow run begins to move is what it is driven for.
    known &= ~np.array([run.run.is_slow for run in runs])
    usual = float(np.median(ahead[known])) if known.any() else tracker_ahead_s
    off = np.where(known, ahead - usual, 0.0)
    excluded = {
        int(i): Exclusion(
            Fault.OTHER_START, f"it begins to move {off[i]:+.1f} s from where its commands put that"
        )
        for i in np.flatnonzero(np.abs(off) > STRAY_S)
    }
    return np.full(len(runs), usual), excluded


def _answered_s(run: FlatRun) -> float:
    """When a robot should have moved that far, on the robot's clock."""
    commands = run.run.commands
    told = np.maximum(np.abs(commands.left), np.abs(commands.right))
    return float(commands.time_s[int(np.argmax(told >= MOVING_ACTION))]) + REACTION_S


def _onset_s(run: FlatRun) -> float:
    """When the robot began to move, on the tracker's clock; NaN if the track begins too late."""
    first = run.time_s < run.time_s[0] + RESTING_S
    away = np.abs(run.place - np.median(run.place[first]))
    turned = np.abs(run.heading - np.median(run.heading[first]))
    moving = (_median_of_five(away) > MOVED_M) | (_median_of_five(turned) > TURNED_RAD)
    begin = float(run.time_s[int(np.argmax(moving))])
    return begin if moving.any() and begin > run.time_s[0] + RESTING_S else np.nan


def kinematic_guess(
    runs: Sequence[ObservedRun], robot: RobotParameters, maps: WheelMaps
) -> KinematicGuess:
    """Work it out for the runs of one recording.

    Raises:
        ConfigurationError: no run holds steady driving, the robot turns against its commands, a
            motor or the tracker is mirrored, or speeds make no sense.

    """
    rows = [
        (index, _volt_shares(left, right, robot, maps), _steady(run, chosen))
        for index, run in enumerate(runs)
        for left, right, chosen in driving(run)
    ]
    if not rows:
        raise ConfigurationError(f"none of the {len(runs)} runs holds a second of steady driving")
    told = np.array([shares for _, shares, _ in rows])
    velocity, turn_rate = (np.array([one[i] for *_, one in rows]) for i in (0, 1))
    _check_mirror(runs)
    if _rank(told) < 2:
        return _from_one_direction(told, np.real(turn_rate), velocity, robot)
    right, left = np.real(_fit(told[:, ::-1] * (1, -1), turn_rate)).tolist()
    _check_senses(left, right)
    from_left, from_right = _fit(told, velocity)
    turned = complex(from_left / left + from_right / right)
    track_m, yaw = abs(turned), -cmath.phase(turned)
    place = complex(from_right / right - from_left / left) * cmath.exp(1j * yaw) / 2j
    _check_speed(max(left, right) * track_m)
    top = max(left, right)
    off = np.maximum(
        np.abs(turn_rate - told @ (-left, right)) / (2 * top),
        np.abs(velocity - told @ (from_left, from_right)) / (top * track_m),
    )
    excluded = {
        index: Exclusion(
            Fault.OTHER_TURN,
            f"it turns at {one[1].real:.1f} rad/s, which its commands do not make in the "
            "other runs",
        )
        for (index, _, one), far in zip(rows, off, strict=True)
        if far > MOST_STRAY
    }
    return KinematicGuess(left * track_m, right * track_m, track_m, place, yaw, excluded)


def gain_of(speed_m_s: float, robot: RobotParameters) -> float:
    """The motor gain with which the simulated wheel rolls at this speed at full voltage."""
    loaded = robot.free_speed_rad_s * robot.wheel_radius_m / (1 + robot.load_loss)
    return speed_m_s / loaded


def _steady(run: ObservedRun, chosen: NDArray[np.bool_]) -> tuple[complex, complex]:
    """Velocity in the tracker's frame [m/s] and turn rate [rad/s] over these increments."""
    ahead, left, turned = run.seen[:, chosen].sum(axis=1)
    elapsed_s = float(np.diff(run.bins.time_s)[chosen].sum())
    rate = float(turned) / elapsed_s
    # A chord is shorter than its arc, and so is a mean of points on one: sin(x) / x each.
    half = rate * float(np.median(np.diff(run.bins.time_s))) / 2
    shrunk = np.sinc(half / np.pi) ** 2
    return complex(ahead, left) / elapsed_s / shrunk, complex(rate)


def _volt_shares(
    left: float, right: float, robot: RobotParameters, maps: WheelMaps
) -> tuple[float, float]:
    told = pwm_duties(maps.duties(to_steps(left, right)))
    motors = (robot.left_motor, robot.right_motor)
    shares = (motor_voltage(d, m, 1.0) / m.gain for d, m in zip(told, motors, strict=True))
    left_share, right_share = shares
    return left_share, right_share


def _check_mirror(runs: Sequence[ObservedRun]) -> None:
    """Refuse a tracker whose place turns the other way than its attitude, in most turns."""
    mirrored: list[bool] = []
    for run in runs:
        turned = np.cumsum(run.seen[2])
        if turned.size and np.ptp(turned) > 2 * np.pi:
            step = run.seen[0] + 1j * run.seen[1]
            # In its own frame it moves one way; mirrored, that way turns round twice as fast.
            along, against = abs(step.sum()), abs((step * np.exp(2j * turned)).sum())
            mirrored.append(against > 2 * along)
    if sum(mirrored) > len(mirrored) / 2:
        raise ConfigurationError(
            "the tracked place turns the other way than the tracked attitude: one of the two is "
            "mirrored (an axis with the wrong sign, or the order of columns in track.toml)"
        )


def _check_senses(left: float, right: float) -> None:
    """Refuse wheels that roll against their commands: turn rate by each one's forward command."""
    if left > 0 and right > 0:
        return
    if left < 0 and right < 0:
        raise ConfigurationError(TURNS_AGAINST)
    side = "left" if left < 0 else "right"
    raise ConfigurationError(
        f"the {side} motor runs against its commands: told to drive straight, the robot turns; "
        "swap its two wires, or set `reversed` in the robot's configuration, and record again"
    )


def _check_speed(speed_m_s: float) -> None:
    if not SLOWEST_M_S < speed_m_s < FASTEST_M_S:
        raise ConfigurationError(
            f"a wheel rolls at {speed_m_s:.3g} m/s at full command, expected about 0.4: are the "
            "tracks in metres and seconds? (position_unit and time_unit in track.toml)"
        )


def _rank(told: Array) -> int:
    sizes = np.linalg.svd(told, compute_uv=False)
    return int(np.count_nonzero(sizes > TELLING * sizes[0]))


def _fit(columns: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
    """Least absolute deviations, near enough: a spoilt run must not turn the others over."""
    weight = np.ones(len(values))
    found = np.zeros(columns.shape[1])
    for _ in range(30):
        found, *_ = np.linalg.lstsq(columns * weight[:, None], values * weight, rcond=None)
        off = np.abs(values - columns @ found)
        weight = 1 / np.sqrt(np.maximum(off, 1e-3 * (1e-9 + float(np.abs(values).max()))))
    return found


def _from_one_direction(
    told: Array, turn_rate: Array, velocity: NDArray[np.complex128], robot: RobotParameters
) -> KinematicGuess:
    """When both wheels were always told the same, or one alone: with the track as it is known."""
    largest = int(np.argmax(np.abs(told).sum(axis=1)))
    direction = told[largest] / np.abs(told[largest]).max()
    amount = told @ direction / (direction @ direction)
    rate = float(np.real(_fit(amount[:, None], turn_rate)[0]))
    way = complex(_fit(amount[:, None], velocity)[0])
    if rate * float(direction[1] - direction[0]) < 0 and abs(direction[1] - direction[0]) > 0.5:
        raise ConfigurationError(TURNS_AGAINST)
    # Taken as if the tracker sat on the axle's centre.
    forward = abs(way) * (1 if direction.sum() >= 0 else -1)
    speeds = forward - rate * robot.track_m / 2, forward + rate * robot.track_m / 2
    left, right = (
        abs(speed / share) if abs(share) > TELLING else None
        for speed, share in zip(speeds, direction.tolist(), strict=True)
    )
    _check_speed(max(left or 0, right or 0))
    yaw = -cmath.phase(way / forward) if abs(forward) > SLOWEST_M_S else 0.0
    return KinematicGuess(left, right, None, 0j, yaw, {})


def _median_of_five(values: Array) -> Array:
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, 2, mode="edge"), 5)
    return np.asarray(np.median(windows, axis=1), np.float64)
