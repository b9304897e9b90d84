"""From a finished fit to values with intervals, and to what can't be told."""

import numpy as np

from mbot_workstation.identification.estimate import Estimate
from mbot_workstation.identification.extras import EXTRAS
from mbot_workstation.identification.friction import DRY_NAME, GRIP_NAME, FrictionFinding
from mbot_workstation.identification.linearisation import Linearisation
from mbot_workstation.identification.mixed_fit import MixedFit
from mbot_workstation.identification.parameters import BY_NAME, NAMES, value
from mbot_workstation.identification.preparation import Prepared
from mbot_workstation.identification.selection import Selection
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.variation.presets import measured

QUANTILE_95 = 1.96


def estimates(
    fit: MixedFit,
    here: Linearisation,
    nominal: RobotParameters,
    selection: Selection,
    finding: FrictionFinding,
) -> tuple[Estimate, ...]:
    """Of all parameters.

    Args:
        fit: finished, and
        here: judged.
        nominal: what they were.
        selection, finding: what was fitted, and why not the rest.

    """
    covariance = here.covariance()
    width = _quantile(len(fit.views) - len(selection.names))
    reasons = dict.fromkeys(EXTRAS, "the runs show none")
    reasons |= selection.undetermined
    if finding.dry_reason is not None:
        reasons[DRY_NAME] = finding.dry_reason
    if finding.grip_reason is not None:
        reasons[GRIP_NAME] = finding.grip_reason
    result: list[Estimate] = []
    for name in NAMES:
        found, before = value(fit.state.robot, name), value(nominal, name)
        if name in selection.names:
            index = selection.names.index(name)
            half = width * float(np.sqrt(covariance[index, index]))
            limits = BY_NAME[name]
            low, high = max(found - half, limits.low), min(found + half, limits.high)
            result.append(Estimate(name, found, before, min(low, found), max(high, found)))
        else:
            result.append(Estimate(name, found, before, why_not=reasons.get(name)))
    return tuple(result)


def latency(
    fit: MixedFit, here: Linearisation, prepared: Prepared, *, same_clock: bool
) -> Estimate:
    """From command to wheel [s], if the clocks were one."""
    before = measured().action_latency_ms / 1000
    if not same_clock:
        why = (
            "a tracker whose clock is not the robot's shows the sum of this delay and the clocks' "
            "difference; record with one clock and give --same-clock"
        )
        return Estimate("latency_ms", before, before, why_not=why)
    first = len(here.names)
    guessed = {view.flat.recording: view.ahead_s for view in prepared.views}
    found = [fit.state.settings[index, 0] + ahead_s for index, ahead_s in guessed.items()]
    sd = float(np.sqrt(here.covariance()[first, first]))
    middle, half = max(float(np.mean(found)), 0.0), _quantile(len(fit.views)) * sd
    return Estimate("latency_ms", middle, before, max(middle - half, 0.0), middle + half)


def _quantile(degrees: int) -> float:
    """Of Student's t for 95 %, near enough from 3 degrees of freedom on."""
    z = QUANTILE_95
    return z + (z**3 + z) / (4 * max(degrees, 2))
