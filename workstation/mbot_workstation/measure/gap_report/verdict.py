"""Does a policy hold on this robot? One word a quantity, and the number behind it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from mbot_workstation.learn.studies.tolerance_file import MapAxis, RewardMap, Tolerances
from mbot_workstation.measure.gap_report.quantities import Quantity
from mbot_workstation.measure.tracks.track import Array

HALF_WAY = 0.5
"""Of the way to the border: the other half is for what adds up, and for the map's own noise."""


class Word(StrEnum):
    """The verdict."""

    FINE = "fine"
    BORDERLINE = "borderline"
    WILL_NOT_HOLD = "will not hold"
    UNKNOWN = "not known"


@dataclass(frozen=True, slots=True, eq=False)
class ToleratedRange:
    """Reward over one deviation, everything else nominal.

    Attributes:
        nominal: the deviation's value on the nominal robot.
        values, rewards: along the map, ascending; shares of the nominal robot's reward; (n,).
        low, high: the first values beyond nominal, downward and upward, at which too little is
            left; the map's own ends where enough is left as far as it reaches.
        ends_low, ends_high: whether they are such ends, so that the border is further out.

    """

    nominal: float
    values: Array
    rewards: Array
    low: float
    high: float
    ends_low: bool
    ends_high: bool

    def reward_share(self, value: float) -> float:
        """What is left of the nominal reward there; at the map's end beyond it."""
        return float(np.interp(value, self.values, self.rewards))

    def used(self, value: float) -> float:
        """The deviation as a share of what is tolerated on its side; 1 at the border."""
        border = self.high if value > self.nominal else self.low
        room, away = abs(border - self.nominal), abs(value - self.nominal)
        return 0.0 if away == 0 else away / room if room > 0 else math.inf

    def is_charted(self, value: float) -> bool:
        """Whether the map reaches so far, or the border comes before."""
        is_end = self.ends_high if value > self.nominal else self.ends_low
        return bool(self.values[0] <= value <= self.values[-1]) or not is_end

    def place(self, value: float) -> float:
        """Where a value lies on the map, from 0 at its lower end to 100; its ends beyond them."""
        return float(np.interp(value, (self.values[0], self.values[-1]), (0, 100)))


@dataclass(frozen=True, slots=True)
class ToleranceVerdict:
    """On one value of one quantity.

    Attributes:
        verdict: see `Word`.
        value: on the map's axis; None if not known.
        used: its deviation as a share of what the policy bears; None if it bears none at all.
        reward_share: what is left there of the nominal reward; None if there is no verdict.
        why: if there is no verdict, or it is from beyond the map.

    """

    verdict: Word
    value: float | None = None
    used: float | None = None
    reward_share: float | None = None
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class JudgedQuantity:
    """A quantity, what the policy bears of it, and the verdicts on a policy trained on the nominal
    robot and on one trained on this robot's calibration.
    """

    quantity: Quantity
    tolerated: ToleratedRange | None
    uncalibrated: ToleranceVerdict
    calibrated: ToleranceVerdict


def judge(quantity: Quantity, tolerances: Tolerances | None) -> JudgedQuantity:
    """Hold a quantity against the maps, if there are any."""
    tolerated = None if tolerances is None else tolerated_range(tolerances, quantity.deviation)
    why = "no tolerance map" if tolerances is None else "no map knows it"
    return JudgedQuantity(
        quantity,
        tolerated,
        _verdict(quantity.uncalibrated, tolerated, "not measured", why),
        _verdict(quantity.calibrated, tolerated, "not checked", why),
    )


def _verdict(
    value: float | None, tolerated: ToleratedRange | None, without_value: str, without_map: str
) -> ToleranceVerdict:
    if value is None or tolerated is None:
        return ToleranceVerdict(
            Word.UNKNOWN, value, why=without_value if value is None else without_map
        )
    used = tolerated.used(value)
    word = Word.FINE if used <= HALF_WAY else Word.BORDERLINE if used <= 1 else Word.WILL_NOT_HOLD
    why = ""
    if used > 1 and not tolerated.is_charted(value):
        word, why = Word.BORDERLINE, "beyond the map's end"
    return ToleranceVerdict(
        word, value, used if used < math.inf else None, tolerated.reward_share(value), why
    )


def tolerated_range(tolerances: Tolerances, name: str) -> ToleratedRange | None:
    """The strictest of what the maps say about a deviation; None if none knows it."""
    found = [
        _range_of(axis, line, tolerances)
        for one in tolerances.maps
        for axis, line in _lines(one)
        if axis.name == name
    ]
    return min(found, key=lambda one: one.high - one.low) if found else None


def _lines(one: RewardMap) -> Iterator[tuple[MapAxis, Array]]:
    """Rewards along each axis, where the other one is nominal."""
    rewards = np.array(one.rewards)
    for axis, other, lines in ((one.across, one.up, rewards.T), (one.up, one.across, rewards)):
        yield axis, np.array([np.interp(other.nominal, other.values, line) for line in lines])


def _range_of(axis: MapAxis, line: Array, tolerances: Tolerances) -> ToleratedRange:
    values, shares = np.array(axis.values), line / tolerances.nominal_reward
    enough = tolerances.tolerated_share
    high = _border(values, shares, axis.nominal, enough)
    low = _border(-values[::-1], shares[::-1], -axis.nominal, enough)
    return ToleratedRange(
        nominal=axis.nominal,
        values=values,
        rewards=shares,
        low=float(values[0]) if low is None else -low,
        high=float(values[-1]) if high is None else high,
        ends_low=low is None,
        ends_high=high is None,
    )


def _border(values: Array, shares: Array, nominal: float, enough: float) -> float | None:
    """The first value from nominal upward at which too little is left; None if there is none."""
    before, share_before = nominal, max(enough, float(np.interp(nominal, values, shares)))
    for value, share in zip(values.tolist(), shares.tolist(), strict=True):
        if value <= nominal:
            continue
        if share < enough:
            part = (share_before - enough) / (share_before - share)
            return before + part * (value - before)
        before, share_before = value, share
    return None
