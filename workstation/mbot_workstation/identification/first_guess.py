"""Where the fit begins: wheels, track and tracker by plain kinematics, and what cannot be fitted.

A robot whose wheels roll at speeds a (left) and b (right) turns at (b - a) / track. A tracker at
the place o on it (x + iy, from the axle's centre), turned by theta, moves in its own frame at
exp(-i theta) ((a + b) / 2 + i (b - a) / track o). Both are linear in a and b, hence in what the
motors are told, so the steady pieces give everything in closed form.
"""

import cmath
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.actions import WheelMaps, to_steps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.identification.clock_guess import guess_clocks
from mbot_workstation.identification.flat_track import FlatRun
from mbot_workstation.identification.sense_checks import (
    SLOWEST_M_S,
    TURNS_AGAINST,
    check_mirror,
    check_senses,
    check_speed,
)
from mbot_workstation.identification.steady_motion import SteadyPiece, steady_pieces
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.motor import duties, motor_voltage
from mbot_workstation.simulation.robot_parameters import RobotParameters

TELLING = 0.05
"""Of full voltage: less does not tell what a wheel does."""

MOST_STRAY = 0.3
"""Of full speed: a run in which a wheel is off by more was not driven as told."""


@dataclass(frozen=True, slots=True)
class FirstGuess:
    """What one recording's steady driving says.

    Attributes:
        left_m_s, right_m_s: speed of each wheel at full voltage; None if no run drove it.
        track_m: None if it does not show.
        tracker: its place on the robot [m], x + iy ahead and to the left.
        tracker_yaw_rad: how far it is turned to the left on the robot.
        ahead_s: the tracker's clock minus the robot's, with the wheels' delay in it, one a run.
        stray: runs that can't be used, by their index, and why.

    """

    left_m_s: float | None
    right_m_s: float | None
    track_m: float | None
    tracker: complex
    tracker_yaw_rad: float
    ahead_s: Array
    stray: dict[int, str]


def first_guess(
    runs: Sequence[FlatRun],
    robot: RobotParameters,
    maps: WheelMaps,
    tracker_ahead_s: float | None,
) -> FirstGuess:
    """Work it out for the runs of one recording.

    Raises:
        ConfigurationError: the robot turns against its commands, a motor or the tracker is
            mirrored, or speeds make no sense.

    """
    ahead_s, stray = guess_clocks(runs, robot, tracker_ahead_s)
    pieces: list[SteadyPiece] = []
    owners: list[int] = []
    for index, run in enumerate(runs):
        if index not in stray:
            found = steady_pieces(run, float(ahead_s[index]))
            if not found:
                stray[index] = "it holds no second of steady driving"
            pieces += found
            owners += [index] * len(found)
    if not pieces:
        index, why = next(iter(stray.items()))
        raise ConfigurationError(
            f"none of the {len(runs)} runs can be used; {runs[index].name}: {why}"
        )
    check_mirror(pieces)
    told = np.array([_volt_shares(piece, robot, maps) for piece in pieces])
    turn_rate = np.array([piece.turn_rate for piece in pieces])
    velocity = np.array([piece.velocity for piece in pieces])
    if _rank(told) < 2:
        return _from_one_direction(told, turn_rate, velocity, robot, ahead_s, stray)
    right, left = (float(rate.real) for rate in _fit(told[:, ::-1] * (1, -1), turn_rate))
    check_senses(left, right)
    from_left, from_right = _fit(told, velocity)
    turned = complex(from_left / left + from_right / right)
    track_m, yaw = abs(turned), -cmath.phase(turned)
    place = complex(from_right / right - from_left / left) * cmath.exp(1j * yaw) / 2j
    check_speed(max(left, right) * track_m)
    top = max(left, right)
    off = np.maximum(
        np.abs(turn_rate - told @ (-left, right)) / (2 * top),
        np.abs(velocity - told @ (from_left, from_right)) / (top * track_m),
    )
    for index, piece, far in zip(owners, pieces, off, strict=True):
        if far > MOST_STRAY:
            stray[index] = (
                f"it turns at {piece.turn_rate:.1f} rad/s, which its commands do not make in the "
                "other runs"
            )
    return FirstGuess(left * track_m, right * track_m, track_m, place, yaw, ahead_s, stray)


def gain_of(speed_m_s: float, robot: RobotParameters) -> float:
    """The motor gain with which the simulated wheel rolls at this speed at full voltage."""
    loaded = robot.free_speed_rad_s * robot.wheel_radius_m / (1 + robot.load_loss)
    return speed_m_s / loaded


def _volt_shares(
    piece: SteadyPiece, robot: RobotParameters, maps: WheelMaps
) -> tuple[float, float]:
    left, right = duties(maps.to_board(to_steps(piece.left, piece.right)))
    return (
        motor_voltage(left, robot.left_motor, 1.0) / robot.left_motor.gain,
        motor_voltage(right, robot.right_motor, 1.0) / robot.right_motor.gain,
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
    told: Array,
    turn_rate: Array,
    velocity: NDArray[np.complex128],
    robot: RobotParameters,
    ahead_s: Array,
    stray: dict[int, str],
) -> FirstGuess:
    """When both wheels were always told the same, or one alone: with the track as it is known."""
    largest = int(np.argmax(np.abs(told).sum(axis=1)))
    direction = told[largest] / np.abs(told[largest]).max()
    amount = told @ direction / (direction @ direction)
    rate = float(_fit(amount[:, None], turn_rate)[0].real)
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
    check_speed(max(left or 0, right or 0))
    yaw = -cmath.phase(way / forward) if abs(forward) > SLOWEST_M_S else 0.0
    return FirstGuess(left, right, None, 0j, yaw, ahead_s, stray)
