"""In what a robot differs from a simulated one, read from held-out driving alone.

Whether motors, wheels or load are to blame makes no difference to a policy: what counts is how far
the robot rolls and turns on the same commands. So these are effective values, on the axes of the
tolerance maps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.gap_report.compared_run import CALIBRATED, MEASURED, NOMINAL
from mbot_workstation.gap_report.steady_rates import Rate, RunRates

STRAIGHT = ("forward-forward", "backward-backward")
SPINS = ("forward-backward", "backward-forward")


@dataclass(frozen=True, slots=True)
class Driving:
    """What a robot makes of full commands.

    Attributes:
        asymmetry: how much further the left wheel rolls than the right one, as a share.
        speed_mps: straight ahead or back, never negative.
        track_m: between the wheels, as turning on the spot shows it.

    """

    asymmetry: float
    speed_mps: float
    track_m: float


@dataclass(frozen=True, slots=True)
class Deviation:
    """The real robot against a simulated one: 0, 1, 1 if they agree.

    Attributes:
        asymmetry: the left wheel is stronger by this share, beyond the simulated one.
        radius_scale: it rolls this much further.
        track_scale: its wheels act as if they were this much further apart.

    """

    asymmetry: float
    radius_scale: float
    track_scale: float


def deviation(rates: Sequence[RunRates], simulated: str) -> Deviation | None:
    """From the mean of all runs; None without runs straight on and on the spot.

    Args:
        rates: of the runs.
        simulated: "calibrated" or "nominal".

    """
    assert simulated in (CALIBRATED, NOMINAL)
    real, model = driving(rates, MEASURED), driving(rates, simulated)
    if real is None or model is None:
        return None
    return Deviation(
        asymmetry=real.asymmetry - model.asymmetry,
        radius_scale=real.speed_mps / model.speed_mps,
        track_scale=real.track_m / model.track_m,
    )


def driving(rates: Sequence[RunRates], path: str) -> Driving | None:
    """What these runs show of a robot; None without runs straight on and on the spot."""
    straight = [one.rate(path) for one in rates if one.maneuver in STRAIGHT]
    spins = [one.rate(path) for one in rates if one.maneuver in SPINS]
    if not straight or not spins:
        return None
    speed_mps = float(np.mean([abs(rate.speed_mps) for rate in straight]))
    turn_radps = float(np.mean([abs(rate.turn_radps) for rate in spins]))
    if speed_mps <= 0 or turn_radps <= 0:
        return None
    track_m = 2 * speed_mps / turn_radps
    asymmetries = [_asymmetry(rate, track_m) for rate in straight]
    return Driving(float(np.mean(asymmetries)), speed_mps, track_m)


def _asymmetry(rate: Rate, track_m: float) -> float:
    """Left minus right wheel over their mean; the same driving backward."""
    return -rate.turn_radps * track_m / rate.speed_mps
