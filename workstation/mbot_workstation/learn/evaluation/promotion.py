"""Whether a policy may take another's place: nearer to the hand on drives that neither has learned
from, and no worse at anything else beyond the intervals.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.learn.evaluation.episodes import Estimate, ratio

Trialled = Literal["hand", "simulation", "pictures"]
"""By what two policies are compared."""

FEWEST_DRIVES = 2
"""With a hand's beats: the interval is over drives, and one says nothing of the next."""


@dataclass(frozen=True, slots=True)
class Compared:
    """Two policies by one measure, on the same drives, episodes or pictures.

    Attributes:
        by: which.
        name: of the measure, in words.
        count: of drives, episodes or pictures.
        before, after: of the policy that is there, and of the new one.
        gain: of the new one, drive by drive, episode by episode; above 0 it is better.

    """

    by: Trialled
    name: str
    count: int
    before: Estimate
    after: Estimate
    gain: Estimate

    @property
    def is_better(self) -> bool:
        """Beyond the interval."""
        return self.gain.low > 0

    @property
    def is_worse(self) -> bool:
        """Likewise."""
        return self.gain.high < 0


@dataclass(frozen=True, slots=True)
class Promotion:
    """What a gate says.

    Attributes:
        model, against: digests of the new policy and of the one that is there.
        passed: whether it may take its place.
        objections: why not, in words.
        compared: by what that was found out.

    """

    model: str
    against: str
    passed: bool
    objections: tuple[str, ...]
    compared: tuple[Compared, ...]


def compare(
    by: Trialled,
    name: str,
    before: Sequence[float],
    after: Sequence[float],
    *,
    weights: Sequence[float] | None = None,
    more_is_better: bool = False,
) -> Compared:
    """Two policies by what each made of the same n drives, episodes or pictures.

    Args:
        by, name: of the measure.
        before, after: sums, n of each.
        weights: of how many things each is the sum; 1 if not given.
        more_is_better: of the measure.

    """
    was, now = np.array(before, np.float64), np.array(after, np.float64)
    below: NDArray[np.float64] = np.ones(len(was)) if weights is None else np.array(weights)
    gain = now - was if more_is_better else was - now
    estimates = (ratio(one, below) for one in (was, now, gain))
    return Compared(by, name, len(was), *estimates)


def objections(compared: Sequence[Compared]) -> Iterator[str]:
    """Why a policy may not take the other's place; none: it may."""
    by_hand = [one for one in compared if one.by == "hand"]
    if not by_hand:
        yield "nobody's hand was compared with"
    for one in by_hand:
        if one.count < FEWEST_DRIVES:
            yield f"{one.count} drive held out with a hand's beats, expected at least 2"
        elif not one.is_better:
            yield f"{one.name}: not better beyond the interval"
    if not any(one.by == "simulation" for one in compared):
        yield "nothing was tried in simulation"
    yield from (f"{one.name}: worse beyond the interval" for one in compared if one.is_worse)
