"""How a robot moves once it moves steadily, and how soon that is: what fits are judged by."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Rates = dict[str, tuple[float, float, float | None, float]]
"""Of each maneuver: forward speed [m/s], turn rate [rad/s], and the times [s] in which both come
to 63 % of that; None where they hardly move."""

SLOWEST_M_S = 0.05
"""Below, a speed has no time constant worth telling."""


def steady_rates(
    forward: Array, turn: Array, step_s: float
) -> tuple[float, float, float | None, float]:
    """Means of the second half, and when 63 % of them were reached; as in `Rates`.

    Args:
        forward: speed [m/s] at each step from standstill, shape (steps,).
        turn: rate [rad/s], likewise.
        step_s: between them.

    """
    late = len(forward) // 2
    speed, rate = float(forward[late:].mean()), float(turn[late:].mean())
    time_s = _time_s(forward, speed, step_s) if abs(speed) > SLOWEST_M_S else None
    return speed, rate, time_s, _time_s(turn, rate, step_s)


def _time_s(values: Array, steady: float, step_s: float) -> float:
    share = values / steady if steady else values
    return (int(np.argmax(share >= 1 - np.exp(-1))) + 0.5) * step_s
