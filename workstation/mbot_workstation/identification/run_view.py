"""One run as the fit sees it: what the simulated robot's tracker would show, and what changes it.

In the plane, with complex numbers for points: the simulated path X(s), psi(s) begins in the origin
along +x; the robot was put down at p0, turned by psi0; the tracker sits at o on the robot, turned
by theta, and its clock is ahead. So at the tracker's time t it should be seen at
p0 + exp(i psi0) (X + exp(i psi) o), heading psi0 + psi + theta, with s = t - ahead - start.

Whatever differs from run to run is part of the run's own deviations: each motor's strength over
the whole run and from second to second, what loads both alike, the moment it began, and where on
the robot the point is about which it turns.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.actions import WheelMaps
from mbot_workstation.identification.binning import Binning
from mbot_workstation.identification.flat_track import FlatRun, Plane
from mbot_workstation.identification.parameters import with_values
from mbot_workstation.identification.run_simulation import simulate_paths, step_count, wheel_volts
from mbot_workstation.identification.run_terms import (
    MOMENT,
    OWN,
    PLACE,
    SIDES,
    STRENGTH,
    Residual,
)
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.timestep import TIMESTEP_S

AT_ONCE = 160
"""Simulations in one batch: 60 MB of paths."""

PIECE_S = 1.0
"""A motor's strength may wander from one such piece to the next."""

BEFORE_S = 0.5
"""Standing before the first command that is looked at. What comes after the last command is not:
whether motors brake or roll out is another question than how they drive."""

GUESS_S = 0.1
"""How well the clocks are known at first; so much is left out before the last command."""

NEAREST = 9
"""Samples that are averaged for a moment: a tenth of a second at 90 Hz."""


class RunView:
    """A run's measurements, ready to be compared.

    Attributes:
        flat: the run.
        ahead_s: first guess of the tracker's clock minus the robot's, the wheels' delay included.
        own_clock: whether no other run shares this clock.
        steps: of its simulation.
        drive_s: from the first command to the last.
        since_middle_s: when it began, from the recording's middle; for the clocks' drift.
        pieces: into which its driving is cut.
        piece: in which each step lies, shape (steps,).

    """

    def __init__(
        self, flat: FlatRun, maps: WheelMaps, middle_s: float, ahead_s: float, *, own_clock: bool
    ) -> None:
        commands = flat.run.commands
        self.flat, self.ahead_s, self.own_clock = flat, ahead_s, own_clock
        self.steps = step_count(commands)
        self.drive_s = commands.end_s - commands.start_s
        self.pieces = max(1, math.ceil(self.drive_s / PIECE_S - 0.25))
        self.since_middle_s = commands.start_s - middle_s
        times = np.arange(self.steps) * TIMESTEP_S
        self.piece = np.minimum((times / PIECE_S).astype(int), self.pieces - 1)
        self._maps = maps
        since = flat.time_s - ahead_s - commands.start_s
        chosen = (since >= -BEFORE_S) & (since <= self.drive_s - GUESS_S)
        self._since_s = since[chosen]
        self._place, self._heading = flat.place[chosen], flat.heading[chosen]
        self._binning = Binning(self._since_s)

    @property
    def covered_s(self) -> tuple[float, float]:
        """First and last sample, since the first command; the same if there is none."""
        if not self._since_s.size:
            return 0.0, 0.0
        return float(self._since_s[0]), float(self._since_s[-1])

    @property
    def deviations(self) -> int:
        """How many numbers make this run differ: see `OWN`, and 2 a piece."""
        return len(OWN) + 2 * self.pieces

    @property
    def plan(self) -> tuple[str, Array]:
        """What the run was told, and when, since the first command; without the stop."""
        commands = self.flat.run.commands
        told = (commands.time_s >= commands.start_s) & (commands.time_s < commands.end_s)
        what = f"{commands.left[told].tolist()} {commands.right[told].tolist()} {self._maps}"
        return what, commands.time_s[told] - commands.start_s

    def volts(self, robot: RobotParameters, deviation: Array) -> Array:
        """The wheels' voltages with the run's own deviations. Shape (steps, 2)."""
        commands = self.flat.run.commands
        volts = wheel_volts(robot, commands, self._maps, self.steps)
        stronger = deviation[STRENGTH] + deviation[SIDES, None]
        stronger = stronger + deviation[len(OWN) :].reshape(2, -1)[:, self.piece]
        # Strength is a factor on the gain: dry friction has no part in it.
        frictionless = with_values(robot, {"dry_friction": 0.0})
        return volts + wheel_volts(frictionless, commands, self._maps, self.steps) * stronger.T

    def begin(self, path: Array, setting: Array) -> Array:
        """The starting pose by the beginning of the track alone. Shape (3,)."""
        x, yaw = self.simulated_at(path, self.moments(setting, 0.0))
        early = self._since_s < max(self._since_s[0] + 0.25, 0.0)
        turn = float(np.median((self._heading - yaw - setting[4])[early]))
        seen = np.exp(1j * turn) * (x + np.exp(1j * yaw) * complex(setting[2], setting[3]))
        away = (self._place - seen)[early]
        return np.array([np.median(away.real), np.median(away.imag), turn])

    def end(self, setting: Array, at_s: float) -> tuple[complex, float]:
        """Where the axle's centre was, from where it began, and how far the robot had turned.

        Args:
            setting: of the recording.
            at_s: after the first command; the mean of the nearest samples is taken.

        """
        rest = np.zeros((self.steps + 1, 3))
        x, y, turn = self.begin(rest, setting)
        axle, heading = self._axle(setting)
        near = self._near(self.moments(setting, 0.0), at_s)
        away = (axle - complex(x, y)) * np.exp(-1j * turn)
        return complex(away[near].mean()), float((heading - turn)[near].mean())

    def end_error(self, path: Array, setting: Array, at_s: float) -> tuple[float, float]:
        """How far a simulated path ends from there: distance [m], angle [rad], both positive."""
        x, y, turn = self.begin(path, setting)
        axle, heading = self._axle(setting)
        moments = self.moments(setting, 0.0)
        near = self._near(moments, at_s)
        simulated, yaw = self.simulated_at(path, moments)
        away = axle - complex(x, y) - np.exp(1j * turn) * simulated
        return abs(complex(away[near].mean())), abs(float((heading - turn - yaw)[near].mean()))

    def residual(self, path: Array, setting: Array, pose: Array, deviation: Array) -> Residual:
        """Compare with a simulated path, shape (steps + 1, 3)."""
        x, yaw = self.simulated_at(path, self.moments(setting, deviation[MOMENT]))
        seen = np.exp(1j * pose[2]) * (x + np.exp(1j * yaw) * tracker_place(setting, deviation))
        away = self._place - complex(pose[0], pose[1]) - seen
        values = np.stack([away.real, away.imag, self._heading - pose[2] - yaw - setting[4]])
        of_place, place_m = self._binning.weigh(values[:2])
        of_heading, heading_rad = self._binning.weigh(values[2:])
        weights = np.stack([of_place, of_place, of_heading])
        samples = self._binning.sums(weights)
        means = self._binning.sums(values * weights) / samples
        return Residual(means, samples, weights, (place_m, heading_rad))

    def moments(self, setting: Array, later_s: float) -> Array:
        """When the samples were taken, since the first command took effect."""
        return self._since_s - setting[0] - setting[1] * self.since_middle_s - later_s

    def _axle(self, setting: Array) -> tuple[Plane, Array]:
        """Of each sample the axle's centre, as the tracker's place says, and the heading."""
        heading = self._heading - setting[4]
        return self._place - np.exp(1j * heading) * tracker_place(setting, None), heading

    def _near(self, moments: Array, at_s: float) -> np.ndarray:
        return np.argsort(np.abs(moments - at_s))[:NEAREST]

    def simulated_at(self, path: Array, moments: Array) -> tuple[Plane, Array]:
        """Place and heading of a simulated path at these moments."""
        index, share = steps_at(path, moments)
        found = path[index] * (1 - share)[:, None] + path[index + 1] * share[:, None]
        return found[:, 0] + 1j * found[:, 1], found[:, 2]

    def averaged(self, residual: Residual, place: NDArray[Any], heading: Array) -> Array:
        """Values of each sample averaged over bins as a residual was.

        Args:
            residual: found here.
            place, heading: shape (k, n).

        Returns:
            Shape (k, 3, bins).

        """
        stacked = np.stack([np.real(place), np.imag(place), heading], axis=1)
        return self._binning.sums(stacked * residual.weights) / residual.samples


def tracker_place(setting: Array, deviation: Array | None) -> complex:
    """Where the tracker sits on the robot [m], ahead + i left, in this run."""
    if deviation is None:
        return complex(setting[2], setting[3])
    return complex(*(setting[2:4] + deviation[PLACE]))


def steps_at(path: Array, moments: Array) -> tuple[NDArray[np.intp], Array]:
    """Which step of a path a moment falls into, and which share of it has passed."""
    grid = np.clip(moments / TIMESTEP_S, 0, len(path) - 1.000001)
    index = grid.astype(int)
    return index, grid - index


def simulate_views(
    views: Sequence[RunView], robots: Sequence[RobotParameters], deviations: Sequence[Array]
) -> list[Array]:
    """One path a run, each as long as its run, shape (steps + 1, 3)."""
    paths: list[Array] = []
    for first in range(0, len(views), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        steps = max(view.steps for view in views[some])
        volts = np.zeros((len(views[some]), steps, 2))
        for row, view, robot, own in zip(
            volts, views[some], robots[some], deviations[some], strict=True
        ):
            row[: view.steps] = view.volts(robot, own)
        found = simulate_paths(robots[some], volts)
        paths += [path[: v.steps + 1] for path, v in zip(found, views[some], strict=True)]
    return paths
