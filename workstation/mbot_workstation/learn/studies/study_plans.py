"""The studies that the paper made or named, as data."""

from collections.abc import Callable
from dataclasses import dataclass

from mbot_workstation.learn.studies.study_run import Condition, Study
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.effects.presets import NOMINAL, PRESETS, preset

Robots = Callable[[str], EffectRanges]
"""Presets by name: `preset`, or those around a calibrated robot."""


def _handicap(robots: Robots) -> Study:
    whole = robots("nominal")
    left, right = whole.low.left_gain, whole.low.right_gain
    return Study(
        "handicap",
        "One motor at half its force",
        "The paper weakened one motor to 50 %: its robot overshot and still reached the object.",
        (
            Condition("nominal", whole),
            Condition("left motor 50 %", whole.changed(left_gain=left / 2)),
            Condition("right motor 50 %", whole.changed(right_gain=right / 2)),
        ),
    )


def _blur(robots: Robots) -> Study:
    return Study(
        "blur",
        "Motion blur",
        "The paper's weakness: pictures blur in fast turns. How much exposure does a policy bear, "
        "and what does a blur lesson change?",
        tuple(
            Condition(f"{ms} ms", robots("nominal").changed(exposure_ms=float(ms)), float(ms))
            for ms in (0, 10, 20, 30, 45, 60)
        ),
        axis="exposure time (ms)",
    )


def _latency(robots: Robots) -> Study:
    return Study(
        "latency",
        "Latency from picture to wheels",
        "The paper's robot streamed its pictures to a workstation: 400 ms mean latency. What does "
        "deciding on the robot (about 90 ms) gain?",
        tuple(
            Condition(f"{ms} ms", _late(robots("nominal"), float(ms)), float(ms))
            for ms in (0, 50, 100, 200, 300, 400, 500, 600)
        ),
        axis="latency from picture to wheels (ms)",
    )


def _late(robots: EffectRanges, total_ms: float) -> EffectRanges:
    """Robots whose wheels answer exactly so long after the middle of the exposure."""
    return robots.changed(
        camera_latency_ms=total_ms,
        frame_interval_ms=0.0,
        action_latency_ms=0.0,
        action_jitter_ms=0.0,
    )


def _robots(robots: Robots) -> Study:
    return Study(
        "robots",
        "Robots never seen",
        "Nominal and perturbed robots, none of the perturbed ones trained on.",
        tuple(
            Condition(name, robots(name)) for name in PRESETS if name not in ("ideal", "randomised")
        ),
    )


_PLANS = {"handicap": _handicap, "blur": _blur, "latency": _latency, "robots": _robots}

STUDIES = tuple(_PLANS)


def study_plan(name: str, robots: Robots = preset) -> Study:
    """One of `STUDIES`.

    Args:
        name: which.
        robots: the nominal robot and those around it.

    """
    return _PLANS[name](robots)


@dataclass(frozen=True, slots=True)
class Deviation:
    """Something simulation and reality may disagree on.

    Attributes:
        words: what it is, for people.
        unit: of its values.
        low, nominal, high: the range to look at.

    """

    words: str
    unit: str
    low: float
    nominal: float
    high: float

    @property
    def title(self) -> str:
        """For an axis."""
        return f"{self.words} ({self.unit})"


GAIN_ASYMMETRY = "gain asymmetry"
"""One motor stronger by this share, the other weaker by the same."""

DEVIATIONS = {
    GAIN_ASYMMETRY: Deviation("motors", "left stronger by", -0.4, 0.0, 0.4),
    "track_scale": Deviation("track", "of nominal", 0.7, 1.0, 1.3),
    "wheel_radius_scale": Deviation("wheel radius", "of nominal", 0.7, 1.0, 1.3),
    "fov_scale": Deviation("field of view", "of nominal", 0.7, 1.0, 1.3),
    "camera_pitch_deg": Deviation("camera pitch", "degrees further down", -6.0, 0.0, 6.0),
    "camera_latency_ms": Deviation("camera latency", "ms", 0.0, 60.0, 600.0),
    "exposure_ms": Deviation("exposure time", "ms", 0.0, 20.0, 60.0),
    "exposure_gain": Deviation("brightness", "of nominal", 0.4, 1.0, 1.8),
}

PAIRS = (
    (GAIN_ASYMMETRY, "camera_latency_ms"),
    ("track_scale", "wheel_radius_scale"),
    ("fov_scale", "camera_pitch_deg"),
    ("camera_latency_ms", "exposure_ms"),
    ("exposure_gain", "exposure_ms"),
)
"""Of each group, motors, dimensions, camera, time and light, what is likely to add up."""


def deviating(values: dict[str, float], nominal: EffectRanges = NOMINAL) -> EffectRanges:
    """Robots that are off by these deviations.

    Args:
        values: by name; a deviation that is 1 on the nominal robot is a share of its value.
        nominal: the robot, nominal or calibrated.

    """
    robot = nominal.low
    changes = {
        name: value * getattr(robot, name) if DEVIATIONS[name].nominal == 1 else value
        for name, value in values.items()
        if name != GAIN_ASYMMETRY
    }
    if GAIN_ASYMMETRY in values:
        half = values[GAIN_ASYMMETRY] / 2
        changes |= {
            "left_gain": robot.left_gain * (1 + half),
            "right_gain": robot.right_gain * (1 - half),
        }
    return nominal.changed(**changes)
