"""Is there friction to be seen? Tried out, since a wheel that holds or grips knows no slope."""

from collections.abc import Sequence
from dataclasses import dataclass

from mbot_workstation.identification.mixed_fit import MixedFit, Progress
from mbot_workstation.identification.parameters import value, with_values
from mbot_workstation.identification.scatter import Scatter

CLEARLY = 8.0
"""Drop of half the sum of squares from which on friction is taken in: 4 standard deviations."""

ALIKE = 2.0
"""Values whose half sums of squares differ less than this can't be told apart at 95 %."""

DRY = (0.03, 0.1, 0.2)
"""Shares of the motor's torque at standstill. A dead band of 50 of 255 is 0.2, if all of it is dry
friction."""

SLIPPERY = 0.25
"""Where the search for slip begins: at the nominal 0.9 the wheels grip, and a little less grip
changes nothing. Dusty vinyl has 0.3 to 0.5."""

QUICKER = 0.7
"""Wheels that slip seem slower than they are: the search begins with such time constants."""

HOPELESS = 3.0
"""A trial that still costs so many times as much has gone astray."""

WIDE_ROUNDS, ROUNDS, FAR_ROUNDS = 4, 4, 6

DRY_NAME, GRIP_NAME = "dry_friction", "wheel_friction"
_TIMES = ("left_time_constant_s", "right_time_constant_s")


@dataclass(frozen=True, slots=True)
class FrictionFinding:
    """What was tried.

    Attributes:
        slips: whether the wheels' friction on the floor shows.
        dry_reason, grip_reason: why a friction stays as it is; None if it does not.

    """

    slips: bool
    dry_reason: str | None
    grip_reason: str | None


def look_for_friction(
    fit: MixedFit, names: Sequence[str], progress: Progress | None = None
) -> FrictionFinding:
    """Try frictions on a finished fit, and leave it at what explains the runs clearly better."""
    dry_reason = _look_for_dry(fit, names, progress)
    slips = _look_for_slip(fit, names, progress)
    grip = value(fit.state.robot, GRIP_NAME)
    grip_reason = f"no wheels with less grip than {grip:g} explain the runs better"
    return FrictionFinding(slips, dry_reason, None if slips else grip_reason)


def _look_for_dry(fit: MixedFit, names: Sequence[str], progress: Progress | None) -> str | None:
    base = _explored(fit, {}, names, progress)
    trials = {dry: _explored(fit, {DRY_NAME: dry}, names, progress) for dry in DRY}
    least = min(cost for cost, _ in trials.values())
    if base[0] - least < CLEARLY:
        return "no wheels that are held while they stand explain the runs better"
    alike = [dry for dry, (cost, _) in trials.items() if cost - least < ALIKE]
    fit.here = trials[alike[0]][1].here
    if alike[-1] == DRY[-1]:
        return f"a standing wheel is held; {alike[0]:g} and more look alike"
    return None


def _look_for_slip(fit: MixedFit, names: Sequence[str], progress: Progress | None) -> bool:
    if value(fit.state.robot, GRIP_NAME) <= SLIPPERY:
        return False
    base, _ = _explored(fit, {}, names, progress)
    quicker = {name: QUICKER * value(fit.state.robot, name) for name in names if name in _TIMES}
    start = with_values(fit.state.robot, {GRIP_NAME: SLIPPERY, **quicker})
    trial = MixedFit(fit.views, fit.fixed, fit.state.changed(start))
    trial.run([*names, GRIP_NAME], FAR_ROUNDS, progress)
    trial.scatter = fit.scatter
    if trial.cost > HOPELESS * base:
        return False
    trial.run([*names, GRIP_NAME], FAR_ROUNDS, progress, learn=False)
    if base - trial.cost < CLEARLY:
        return False
    fit.here = trial.here
    return True


def _explored(
    fit: MixedFit, change: dict[str, float], names: Sequence[str], progress: Progress | None
) -> tuple[float, MixedFit]:
    """The fit from a changed robot on, with the scatter left alone so that costs compare."""
    trial = fit.branch(with_values(fit.state.robot, change))
    if change:
        # Wide at first: a narrow one holds the rest to where it was without the change.
        trial.scatter = Scatter()
        trial.run(names, WIDE_ROUNDS, progress, learn=False)
        trial.scatter = fit.scatter
    trial.run(names, ROUNDS, progress, learn=False)
    return trial.cost, trial
