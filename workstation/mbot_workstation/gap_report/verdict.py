"""Does a policy hold on this robot? One word a quantity, and the number behind it."""

from dataclasses import dataclass
from enum import Enum

from mbot_workstation.gap_report.bearable import Bearable, bearable
from mbot_workstation.gap_report.quantity import Quantity
from mbot_workstation.training.studies.tolerance_file import Tolerances

HALF_WAY = 0.5
"""Of the way to the border: the other half is for what adds up, and for the map's own noise."""


class Word(Enum):
    """The verdict."""

    FINE = "fine"
    BORDERLINE = "borderline"
    WILL_NOT_HOLD = "will not hold"
    UNKNOWN = "not known"


@dataclass(frozen=True, slots=True)
class Verdict:
    """On one value of one quantity.

    Attributes:
        word: see `Word`.
        value: on the map's axis; None if not known.
        used: its deviation as a share of what the policy bears.
        reward_share: what is left there of the nominal reward.
        why: if there is no verdict, or it is from beyond the map.

    """

    word: Word
    value: float | None = None
    used: float | None = None
    reward_share: float | None = None
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One quantity with both verdicts.

    Attributes:
        quantity: what it is about.
        borne: what the policy bears of it; None without a map.
        uncalibrated: for a policy trained on the nominal robot.
        calibrated: for one trained on this robot's calibration.

    """

    quantity: Quantity
    borne: Bearable | None
    uncalibrated: Verdict
    calibrated: Verdict


def judge(quantity: Quantity, tolerances: Tolerances | None) -> Judged:
    """Hold a quantity against the maps, if there are any."""
    borne = None if tolerances is None else bearable(tolerances, quantity.deviation)
    missing = "no tolerance map" if tolerances is None else "no map knows it"
    return Judged(
        quantity,
        borne,
        _verdict(quantity.uncalibrated, borne, "not measured", missing),
        _verdict(quantity.calibrated, borne, "not checked", missing),
    )


def _verdict(
    value: float | None, borne: Bearable | None, without_value: str, without_map: str
) -> Verdict:
    if value is None:
        return Verdict(Word.UNKNOWN, why=without_value)
    if borne is None:
        return Verdict(Word.UNKNOWN, value, why=without_map)
    used, left = borne.used(value), borne.reward_share(value)
    if used > 1 and not borne.is_charted(value):
        return Verdict(Word.BORDERLINE, value, used, left, "beyond the map's end")
    if used > 1:
        return Verdict(Word.WILL_NOT_HOLD, value, used, left)
    word = Word.FINE if used <= HALF_WAY else Word.BORDERLINE
    return Verdict(word, value, used, left)
