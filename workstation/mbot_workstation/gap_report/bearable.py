"""What of one deviation a policy bears, from the maps that know it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.recordings.track import Array
from mbot_workstation.training.studies.tolerance_file import MapAxis, RewardMap, Tolerances


@dataclass(frozen=True, slots=True, eq=False)
class Bearable:
    """Reward over one deviation, everything else nominal.

    Attributes:
        name, unit: of the deviation.
        nominal: its value on the nominal robot.
        values: ascending, shape (n,).
        rewards: shares of the nominal robot's reward, shape (n,).
        low, high: the first values beyond nominal, downward and upward, at which too little is
            left; the map's own ends where enough is left as far as it reaches.
        ends_low, ends_high: whether they are such ends, so that the border is further out.

    """

    name: str
    unit: str
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
        """The deviation as a share of what is borne on its side; 1 at the border."""
        border = self.high if value > self.nominal else self.low
        room = abs(border - self.nominal)
        away = abs(value - self.nominal)
        if away == 0:
            return 0.0
        return away / room if room > 0 else np.inf

    def is_charted(self, value: float) -> bool:
        """Whether the map reaches so far, or the border comes before."""
        return self.values[0] <= value <= self.values[-1] or not (
            self.ends_high if value > self.nominal else self.ends_low
        )


def bearable(tolerances: Tolerances, name: str) -> Bearable | None:
    """The strictest of what the maps say about a deviation; None if none knows it."""
    found = [
        _of_line(axis, line, tolerances)
        for one in tolerances.maps
        for axis, line in _lines(one)
        if axis.name == name
    ]
    return min(found, key=lambda one: one.high - one.low) if found else None


def _lines(one: RewardMap) -> Sequence[tuple[MapAxis, Array]]:
    """Rewards along each axis, where the other one is nominal."""
    rewards = np.array(one.rewards)
    across = [np.interp(one.up.nominal, one.up.values, column) for column in rewards.T]
    up = [np.interp(one.across.nominal, one.across.values, row) for row in rewards]
    return (one.across, np.array(across)), (one.up, np.array(up))


def _of_line(axis: MapAxis, line: Array, tolerances: Tolerances) -> Bearable:
    values, shares = np.array(axis.values), line / tolerances.nominal_reward
    enough = tolerances.bearable_share
    high = _border(values, shares, axis.nominal, enough)
    low = _border(-values[::-1], shares[::-1], -axis.nominal, enough)
    return Bearable(
        name=axis.name,
        unit=axis.unit,
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
    for value, share in zip(values, shares, strict=True):
        if value <= nominal:
            continue
        if share < enough:
            part = (share_before - enough) / (share_before - share)
            return float(before + part * (value - before))
        before, share_before = float(value), float(share)
    return None
