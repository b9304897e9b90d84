"""The upper bound: a driver that is told where the object is and what the robot is like.

It turns towards the object within one decision and drives as fast as that allows. At 2.5 decisions
a second there is nothing much better: half a turn on the spot takes the nominal robot 0.45 s. It
knows nothing of slipping wheels, and is no strict bound where they do.
"""

from dataclasses import astuple

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.actions import LEVELS
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.body_record import BODY_RECORD, body_record
from mbot_workstation.sim.effects.effects import EffectRanges, RealWorldEffects
from mbot_workstation.tasks.episode import DECISION_S

Actions = NDArray[np.float32]
"""Shape (robots, 2): left and right wheel in [-1, 1]."""

Targets = NDArray[np.float64]
"""Where each robot's object is: shape (robots, 2), metres ahead of the axle and to its left; NaN
where nobody has said yet, as in the first decision of an episode."""

LOOKS_AHEAD = 3
"""Rounds of correcting the bearing by how far the robot drives while it turns."""


def middle(ranges: EffectRanges) -> RealWorldEffects:
    """The robot in the middle of all ranges."""
    low, high = np.array(astuple(ranges.low)), np.array(astuple(ranges.high))
    return RealWorldEffects(*((low + high) / 2).tolist())


class Oracle:
    """Drives a number of robots; their last turns are remembered, since wheels lag.

    Wheel speeds are in shares of the nominal full speed, positive forward.
    """

    def __init__(
        self, robots: int, effects: RealWorldEffects, nominal: RobotParameters | None = None
    ) -> None:
        """Begin with robots that are all of one kind; `become` tells them apart."""
        self._nominal = nominal or RobotParameters()
        self._last_turn = np.zeros(robots)
        body = body_record(effects, self._nominal)
        self.become(np.array([body] * robots, BODY_RECORD))

    def become(self, bodies: NDArray[np.void]) -> None:
        """Say what the robots are like: BODY_RECORD, shape (robots,)."""
        nominal = self._nominal
        self._bodies = bodies
        speed_m_s = (
            nominal.free_speed_rad_s
            * bodies["speed_scale"]
            * nominal.wheel_radius_m
            * bodies["wheel_radius_scale"]
            * (1 - nominal.load_loss)
        )
        self._way_m = speed_m_s * DECISION_S
        # Radians a decision for every unit of difference between right and left wheel.
        self._turn_rad = self._way_m / (nominal.track_m * bodies["track_scale"])
        lag_ms = (
            bodies["action_latency_ms"]
            + bodies["action_jitter_ms"] / 2
            + bodies["time_constant_ms"]
        )
        self._carry = lag_ms / 1000 / DECISION_S

    def act(self, targets: Targets) -> Actions:
        """Both wheels of every robot, shape (robots, 2); robots without a target wait."""
        known = np.isfinite(targets[:, 0])
        ahead, left = np.nan_to_num(targets).T
        bearing = np.arctan2(left, ahead)
        for _ in range(LOOKS_AHEAD):
            _, speed = self._wheels(bearing)
            # While it turns the robot drives a chord at half the angle; from its end the object
            # has another bearing, unless it is met before.
            chord_m = self._way_m * speed
            end_ahead, end_left = chord_m * np.cos(bearing / 2), chord_m * np.sin(bearing / 2)
            seen = np.arctan2(left - end_left, ahead - end_ahead)
            bearing = np.where(np.hypot(ahead, left) > chord_m, seen, bearing)
        turn, speed = (np.where(known, part, 0.0) for part in self._wheels(bearing))
        self._last_turn = turn
        return self.commands(speed - turn / 2, speed + turn / 2)

    @property
    def last_turn(self) -> NDArray[np.float64]:
        """What the right wheel was told beyond the left, shape (robots,)."""
        return self._last_turn

    def drove(self, actions: Actions) -> None:
        """Replace the remembered turns by those of actions that somebody else has taken."""
        turns = [self._speed(actions[:, side], gain) for side, gain in enumerate(self._gains)]
        self._last_turn = turns[1] - turns[0]

    def commands(self, left: NDArray[np.float64], right: NDArray[np.float64]) -> Actions:
        """The actions that give the wheels these speeds, shape (robots, 2)."""
        sides = zip((left, right), self._gains, strict=True)
        return np.stack([self._command(*side) for side in sides], axis=1).astype(np.float32)

    @property
    def _gains(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return self._bodies["left_gain"], self._bodies["right_gain"]

    def _wheels(
        self, bearing: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Difference right - left, and the largest mean speed that it leaves."""
        left, right = self._gains
        # What the wheels still turn from the last command counts towards this bearing.
        wanted = bearing / self._turn_rad - self._carry * self._last_turn
        turn = np.clip(wanted, -left - right, left + right)
        return turn, np.minimum(left + turn / 2, right - turn / 2)

    def _command(
        self, wheel: NDArray[np.float64], gain: NDArray[np.float32]
    ) -> NDArray[np.float64]:
        """The action that gives a wheel this speed, beyond both dead bands."""
        dead_band, compensation = self._bodies["dead_band"], self._bodies["dead_band_compensation"]
        board = dead_band + (LEVELS - dead_band) * np.abs(wheel) / gain
        step = (board - compensation) / (LEVELS - compensation)
        size = np.where(np.abs(wheel) < 1e-3, 0.0, np.clip(step, 0.0, 1.0))
        return np.copysign(size, wheel)

    def _speed(self, action: NDArray[np.float32], gain: NDArray[np.float32]) -> NDArray[np.float64]:
        """The speed that an action gives a wheel, as `_command` the other way round."""
        dead_band, compensation = self._bodies["dead_band"], self._bodies["dead_band_compensation"]
        size = np.minimum(np.abs(action), 1.0)
        board = compensation + (LEVELS - compensation) * size
        share = np.where(size > 0, (board - dead_band) / (LEVELS - dead_band), 0.0)
        return np.copysign(gain * np.maximum(share, 0.0), action)
