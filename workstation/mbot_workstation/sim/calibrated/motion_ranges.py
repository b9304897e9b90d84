"""How far robots in training may differ from a measured one: what identification is sure of."""

import math
from dataclasses import dataclass

from mbot_workstation.sim.calibrated.motion_calibration import Interval, MotionCalibration
from mbot_workstation.sim.effects.effects import EffectRanges

CAUTION = 3.0
"""So many times an interval of 95 % must fit into the range: it is of one day, floor and model."""


@dataclass(frozen=True, slots=True)
class Narrowing:
    """What a known parameter of motion.toml says about an effect.

    Attributes:
        effect: its name in `RealWorldEffects`.
        keys: in motion.toml's intervals; all of them must be known, the widest counts.
        least: the range reaches at least so far to both sides, as a share of the value. What
            changes from day to day, however well one day is known.

    """

    effect: str
    keys: tuple[str, ...]
    least: float


def _both(field: str) -> tuple[str, ...]:
    return tuple(f"{side}_motor.{field}" for side in ("left", "right"))


NARROWINGS = (
    # A motor that warms up or whose brushes wear; new ones of a batch differ by 5 % (assumed).
    Narrowing("left_gain", ("left_motor.gain",), 0.04),
    Narrowing("right_gain", ("right_motor.gain",), 0.04),
    # Gain, free speed and wheel radius show as one product only: known gains are known speeds.
    # The rest is the battery's charge; what it loses under load is `battery_sag`.
    Narrowing("speed_scale", _both("gain"), 0.06),
    # Grease that is warm or cold; and no model has quite the curve of a real start.
    Narrowing("time_constant_scale", _both("time_constant_ms"), 0.15),
    Narrowing("dead_band_scale", _both("dead_band"), 0.12),
    # Tyres that creep on another floor make another effective track.
    Narrowing("track_scale", ("track_m",), 0.015),
    # Tyres wear and sink in.
    Narrowing("wheel_radius_scale", ("wheel_radius_m",), 0.01),
)
"""The least reaches are assumptions; without an interval a range stays as the preset has it."""


def narrowed(ranges: EffectRanges, motion: MotionCalibration) -> EffectRanges:
    """Ranges around a robot, without what identification has ruled out.

    Args:
        ranges: of a preset.
        motion: what was identified, and how surely.

    Returns:
        Ranges that nowhere reach beyond the old ones. Those of what the recordings could not tell
        stay as they were.

    """
    pairs: dict[str, float | tuple[float, float]] = {}
    for one in NARROWINGS:
        intervals = [motion.intervals[key] for key in one.keys if key in motion.intervals]
        if len(intervals) < len(one.keys):
            continue
        reach = max(one.least, *(CAUTION * _half_share(interval) for interval in intervals))
        low, high = getattr(ranges.low, one.effect), getattr(ranges.high, one.effect)
        pairs[one.effect] = max(low, 1 - reach), min(high, 1 + reach)
    return ranges.changed(**pairs)


def _half_share(interval: Interval) -> float:
    """Half of its width, as a share of its middle."""
    half, middle = (interval.high - interval.low) / 2, (interval.high + interval.low) / 2
    return half / middle if middle > 0 else math.inf
