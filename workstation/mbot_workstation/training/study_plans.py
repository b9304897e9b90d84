"""The studies that the paper made or named, as data."""

from dataclasses import dataclass

from mbot_workstation.training.effects import EffectRanges
from mbot_workstation.training.presets import NOMINAL, PRESETS
from mbot_workstation.training.study import Condition, Study

HANDICAP = Study(
    "handicap",
    "One motor at half its force",
    "The paper weakened one motor to 50 %: its robot overshot and still reached the object.",
    (
        Condition("nominal", NOMINAL),
        Condition("left motor 50 %", NOMINAL.changed(left_gain=0.5)),
        Condition("right motor 50 %", NOMINAL.changed(right_gain=0.5)),
    ),
)

BLUR = Study(
    "blur",
    "Motion blur",
    "The paper's weakness: pictures blur in fast turns. How much exposure does a policy bear, and "
    "what does a blur lesson change?",
    tuple(
        Condition(f"{ms} ms", NOMINAL.changed(exposure_ms=float(ms)), float(ms))
        for ms in (0, 10, 20, 30, 45, 60)
    ),
    axis="exposure time (ms)",
)


def _late(total_ms: float) -> EffectRanges:
    """Robots whose wheels answer exactly so long after the middle of the exposure."""
    return NOMINAL.changed(
        camera_latency_ms=total_ms,
        frame_interval_ms=0.0,
        action_latency_ms=0.0,
        action_jitter_ms=0.0,
    )


LATENCY = Study(
    "latency",
    "Latency from picture to wheels",
    "The paper's robot streamed its pictures to a workstation: 400 ms mean latency. What does "
    "deciding on the robot (about 90 ms) gain?",
    tuple(
        Condition(f"{ms} ms", _late(float(ms)), float(ms))
        for ms in (0, 50, 100, 200, 300, 400, 500, 600)
    ),
    axis="latency from picture to wheels (ms)",
)

ROBOTS = Study(
    "robots",
    "Robots never seen",
    "Nominal and perturbed robots, none of the perturbed ones trained on.",
    tuple(
        Condition(name, effects)
        for name, effects in PRESETS.items()
        if name not in ("ideal", "randomised")
    ),
)

STUDIES = {study.name: study for study in (HANDICAP, BLUR, LATENCY, ROBOTS)}


@dataclass(frozen=True, slots=True)
class Deviation:
    """Something simulation and reality may disagree on.

    Attributes:
        unit: of its values, for the axis.
        low, nominal, high: the range to look at.

    """

    unit: str
    low: float
    nominal: float
    high: float


GAIN_ASYMMETRY = "gain asymmetry"
"""One motor stronger by this share, the other weaker by the same."""

DEVIATIONS = {
    GAIN_ASYMMETRY: Deviation("left stronger by", -0.4, 0.0, 0.4),
    "track_scale": Deviation("of nominal", 0.7, 1.0, 1.3),
    "wheel_radius_scale": Deviation("of nominal", 0.7, 1.0, 1.3),
    "fov_scale": Deviation("of nominal", 0.7, 1.0, 1.3),
    "camera_pitch_deg": Deviation("degrees further down", -8.0, 0.0, 8.0),
    "camera_latency_ms": Deviation("ms", 0.0, 60.0, 600.0),
    "exposure_ms": Deviation("ms", 0.0, 20.0, 60.0),
    "exposure_gain": Deviation("of nominal", 0.4, 1.0, 1.8),
}

PAIRS = (
    (GAIN_ASYMMETRY, "camera_latency_ms"),
    ("track_scale", "wheel_radius_scale"),
    ("fov_scale", "camera_pitch_deg"),
    ("camera_latency_ms", "exposure_ms"),
)
"""Of each group, motors, dimensions, camera and time, what is likely to add up."""


def deviating(values: dict[str, float]) -> EffectRanges:
    """Nominal robots that are off by these deviations."""
    changes = {name: value for name, value in values.items() if name != GAIN_ASYMMETRY}
    if GAIN_ASYMMETRY in values:
        half = values[GAIN_ASYMMETRY] / 2
        changes |= {"left_gain": 1 + half, "right_gain": 1 - half}
    return NOMINAL.changed(**changes)
