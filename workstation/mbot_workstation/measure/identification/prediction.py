"""What the simulated robot's tracker would have shown, as increments, and what changes it.

In the plane, with complex numbers for points: a simulated path X(s), psi(s) is seen by a tracker at
the place o on the robot, turned to the left by theta, at X + exp(i psi) o with heading psi + theta.
Its clock is ahead of the robot's.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded

from mbot_workstation.measure.identification.floor import Plane
from mbot_workstation.measure.identification.observed_run import STARTING_S, ObservedRun
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.engine import TIMESTEP_S

SETTING = ("clock", "drift", "ahead", "left", "yaw", "drain")
"""Of a recording: its clock's offset beyond the guess [s] and drift, the tracker's place on the
robot [m], how far it is turned to the left [rad], and the share of its speed that the robot loses
per second as its battery empties."""

SETTING_SPREAD = np.array([0.1, 1e-4, 0.1, 0.1, 1.0, 3e-5])
"""How far they may be from the first guess: far, but a clock off by 1e-4 or a battery that loses a
tenth in an hour is one in three."""

NUISANCE = ("left", "right", "sideways", "delay")
"""A run's nuisance parameters: both wheels' speeds, as shares; a sideways motion, as a share of the
faster wheel's speed; and how much later it
began [s]."""

MISFIT = ("left", "right", "sideways", "left at the start", "right at the start")
"""What the model gets wrong in all runs of a maneuver, as shares of the faster wheel's speed: the
speed of each wheel, a sideways motion, and further the wheels' in the first STARTING_S."""

MOMENT_STEP_S = 0.002


def simulated_at(path: Array, moments_s: Array) -> tuple[Plane, Array]:
    """Axle's centre and heading of simulated paths at these moments.

    Args:
        path: shape (..., steps + 1, 3).
        moments_s: shape (n,).

    Returns:
        Two of shape (..., n).

    """
    grid = np.clip(moments_s / TIMESTEP_S, 0, path.shape[-2] - 1.000001)
    index = grid.astype(int)
    share = (grid - index)[:, None]
    found = path[..., index, :] * (1 - share) + path[..., index + 1, :] * share
    return found[..., 0] + 1j * found[..., 1], found[..., 2]


def moments_s(run: ObservedRun, setting: Array, delay_s: float) -> Array:
    """When the samples were taken, since the first command took effect. Shape (n,).

    Args:
        run: whose samples they are.
        setting: of the recording, shape (6,), see `SETTING`.
        delay_s: than the other runs.

    """
    return run.sample_s - setting[0] - setting[1] * run.since_middle_s - delay_s


def predicted(run: ObservedRun, path: Array, setting: Array, delay_s: float) -> Array:
    """The increments that this run's tracker would have shown.

    Args:
        run: whose samples are used.
        path: simulated, shape (..., steps + 1, 3).
        setting: of the recording, shape (6,).
        delay_s: than the other runs.

    Returns:
        Shape (..., 3, bins - 1).

    """
    place, yaw = simulated_at(path, moments_s(run, setting, delay_s))
    tracked = place + np.exp(1j * yaw) * complex(setting[2], setting[3])
    found = run.bins.increments(tracked, yaw) * (1 - setting[5] * run.since_others_s)
    return _turned(found, setting[4])


@dataclass(frozen=True, slots=True, eq=False)
class Jacobians:
    """Derivatives of a run's predicted increments; shapes (k, 3, bins - 1).

    Attributes:
        settings: by the recording's settings.
        nuisance: by what the run has to itself, see `NUISANCE`.
        misfit: by what the model gets wrong, see `MISFIT`.

    """

    settings: Array
    nuisance: Array
    misfit: Array


def jacobians(
    run: ObservedRun, path: Array, setting: Array, delay_s: float, track_m: float
) -> Jacobians:
    """Analytic but for the delay, in which a path is only piecewise smooth.

    The arguments are those of `predicted`, for one path: shape (steps + 1, 3).
    """
    here = predicted(run, path, setting, delay_s)
    late = predicted(run, path, setting, delay_s + MOMENT_STEP_S)
    early = predicted(run, path, setting, delay_s - MOMENT_STEP_S)
    by_moment = (late - early) / (2 * MOMENT_STEP_S)
    place, yaw = simulated_at(path, moments_s(run, setting, delay_s))
    turning = np.exp(1j * yaw)
    # A tracker further ahead or to the left shows more of the turn, and no other heading.
    offset = [run.bins.increments(turning * way, yaw) * _ONLY_PLACE for way in (1, 1j)]
    by_yaw = np.stack([here[1], -here[0], np.zeros_like(here[0])])
    settings = np.stack(
        [
            by_moment,
            by_moment * run.since_middle_s,
            _turned(offset[0], setting[4]),
            _turned(offset[1], setting[4]),
            by_yaw,
            -here * run.since_others_s,
        ]
    )
    axle = run.bins.increments(place, yaw)
    forward, turned = axle[0], axle[2]
    wheels = forward - turned * track_m / 2, forward + turned * track_m / 2
    faster = np.maximum(np.abs(wheels[0]), np.abs(wheels[1]))
    tracker = complex(setting[2], setting[3])

    def moved(forward_m: Array, turn_rad: Array, left_m: Array) -> Array:
        way = (forward_m + 1j * left_m + 1j * turn_rad * tracker) * np.exp(-1j * setting[4])
        return np.stack([way.real, way.imag, turn_rad])

    still = np.zeros_like(forward)
    nuisance = np.stack(
        [
            moved(wheels[0] / 2, -wheels[0] / track_m, still),
            moved(wheels[1] / 2, wheels[1] / track_m, still),
            moved(still, still, faster),
            by_moment,
        ]
    )
    starting = np.where(run.bins.time_s[1:] < STARTING_S, faster, 0.0)
    misfit = np.stack(
        [
            moved(faster / 2, -faster / track_m, still),
            moved(faster / 2, faster / track_m, still),
            moved(still, still, faster),
            moved(starting / 2, -starting / track_m, still),
            moved(starting / 2, starting / track_m, still),
        ]
    )
    return Jacobians(settings, nuisance, misfit)


_ONLY_PLACE = np.array([1.0, 1.0, 0.0])[:, None]


def _turned(increments: Array, yaw_rad: float) -> Array:
    """As a tracker shows them that is turned to the left by so much."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    ahead, left, turned = np.moveaxis(increments, -2, 0)
    return np.stack([ahead * cosine + left * sine, left * cosine - ahead * sine, turned], axis=-2)


@dataclass(frozen=True, slots=True)
class Noise:
    """Of one recording's increments.

    Attributes:
        place_m, heading_rad: of a single sample of the tracker.
        place_walk, heading_walk: what the robot does by chance, per root of a second [m, rad].

    """

    place_m: float
    heading_rad: float
    place_walk: float
    heading_walk: float


class Whitener:
    """Makes the errors of a run's increments independent, of unit size.

    Neighbouring increments share a bin, so their errors are correlated; what the robot does by
    chance is not. Such a covariance has two bands, and so has its root.
    """

    def __init__(self, run: ObservedRun, noise: Noise) -> None:
        of_place = _root(run, noise.place_m, noise.place_walk)
        of_heading = _root(run, noise.heading_rad, noise.heading_walk)
        self._roots = of_place, of_place, of_heading

    def whiten(self, increments: Array) -> Array:
        """Shape (..., 3, n), as is what comes back."""
        result = np.empty(increments.shape)
        for row, root in enumerate(self._roots):
            flat = increments[..., row, :].reshape(-1, increments.shape[-1])
            white = solve_banded((1, 0), root, flat.T, check_finite=False)
            result[..., row, :] = white.T.reshape(increments[..., row, :].shape)
        return result

    def undo(self, white: Array) -> Array:
        """The increments again. Shape (3, n)."""
        roots = np.stack(self._roots)
        result = roots[:, 0] * white
        result[:, 1:] += roots[:, 1, :-1] * white[:, :-1]
        return np.asarray(result, np.float64)


def _root(run: ObservedRun, single: float, walk: float) -> Array:
    """Of the covariance of n increments: its diagonal and the one below. Shape (2, n)."""
    of_bins = single**2 / run.bins.count
    bands = np.zeros((2, of_bins.size - 1))
    bands[0] = of_bins[1:] + of_bins[:-1] + walk**2 * np.diff(run.bins.time_s)
    bands[1, :-1] = -of_bins[1:-1]
    return np.asarray(cholesky_banded(bands, lower=True, check_finite=False), np.float64)
