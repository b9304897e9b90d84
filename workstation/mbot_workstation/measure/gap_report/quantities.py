"""The quantities a policy may stumble over: what they are on this robot, and how it is known."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.learn.studies.study_plans import DEVIATIONS
from mbot_workstation.measure.gap_report.compare import CALIBRATED, MEASURED, NOMINAL, ComparedRun
from mbot_workstation.measure.gap_report.figures import SPINS, STRAIGHT
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.effects.presets import KNOWN

Pair = tuple[float | None, float | None]
"""A value seen from the nominal simulation, and from the calibrated one; None if not known."""

UNKNOWN: Pair = (None, None)

GRAY_CARD_L = 49.5
"""CIELAB lightness of an 18 % gray card."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One of them, in the values of its tolerance map's axis.

    Attributes:
        title: for people.
        deviation: the axis's name, as in `study_plans.DEVIATIONS`.
        unit: of the values as shown.
        uncalibrated: this robot, seen from the nominal simulation; None if not known.
        calibrated: this robot, seen from its calibrated simulation; None if not known.
        source: where the two come from, or what has to be done to know them.

    """

    title: str
    deviation: str
    unit: str
    uncalibrated: float | None
    calibrated: float | None
    source: str

    @property
    def nominal(self) -> float:
        """The value at which simulation and robot agree."""
        return DEVIATIONS[self.deviation].nominal

    def shown(self, value: float) -> float:
        """A value of the axis as it is told to people: from where both agree, in `unit`."""
        return (100 if self.unit == "%" else 1) * (value - self.nominal)

    def words(self, value: float) -> str:
        """A value as shown, such as "+3.1 %"."""
        shown = self.shown(value)
        text = f"{shown:+.{0 if abs(shown) >= 20 else 1 if abs(shown) >= 1 else 2}f}"
        return f"{text if float(text) else '0'} {self.unit}".replace(" °", "°")


TITLES = {
    "gain asymmetry": ("Gain asymmetry", "%"),
    "track_scale": ("Track", "%"),
    "wheel_radius_scale": ("Wheel radius (effective)", "%"),
    "fov_scale": ("Field of view", "%"),
    "camera_pitch_deg": ("Mounting pitch", "°"),
    "camera_latency_ms": ("Latency", "ms"),
    "exposure_gain": ("Exposure", "%"),
}
"""By the axes of tolerance maps, as in `study_plans.DEVIATIONS`."""


def quantities(files: CalibrationFiles, runs: Sequence[ComparedRun]) -> tuple[Quantity, ...]:
    """All seven, as in `TITLES`: of a robot's calibration, and of its held-out runs."""
    of_files = (_field_of_view, _pitch, _latency, _exposure)
    known = [*_driving(runs), *(look(files) for look in of_files)]
    return tuple(
        Quantity(title, deviation, unit, *values, source)
        for (deviation, (title, unit)), (values, source) in zip(TITLES.items(), known, strict=True)
    )


def deviation(runs: Sequence[ComparedRun], simulated: str) -> tuple[float, float, float] | None:
    """The real robot against a simulated one, on the axes of the tolerance maps.

    Whether motors, wheels or load are to blame makes no difference to a policy: what counts is how
    far the robot rolls and turns on the same commands. So these are effective values.

    Returns:
        By which share the left wheel is stronger, beyond the simulated one; how much further apart
        the wheels act; how much further they roll: 0, 1, 1 if the two agree. None without runs
        straight on and on the spot.

    """
    real, model = _effective(runs, MEASURED), _effective(runs, simulated)
    if real is None or model is None:
        return None
    return real[0] - model[0], real[1] / model[1], real[2] / model[2]


def _effective(runs: Sequence[ComparedRun], path: str) -> tuple[float, float, float] | None:
    """Asymmetry as a share, track [m] and speed [m/s] that full commands show, from all runs."""
    straight, spins = (
        [run.rate(path) for run in runs if run.maneuver in names and run.is_steady]
        for names in (STRAIGHT, SPINS)
    )
    if not straight or not spins:
        return None
    speed_mps = float(np.mean([abs(rate.speed_mps) for rate in straight]))
    turn_radps = float(np.mean([abs(rate.turn_radps) for rate in spins]))
    if speed_mps <= 0 or turn_radps <= 0:
        return None
    track_m = 2 * speed_mps / turn_radps
    # Left minus right wheel over their mean; the same driving backward.
    asymmetry = np.mean([-rate.turn_radps * track_m / rate.speed_mps for rate in straight])
    return float(asymmetry), track_m, speed_mps


def _driving(runs: Sequence[ComparedRun]) -> list[tuple[Pair, str]]:
    before, after = deviation(runs, NOMINAL), deviation(runs, CALIBRATED)
    if before is None or after is None:
        needed = (
            "needs runs of forward-forward or backward-backward and of forward-backward or "
            "backward-forward: `workstation maneuvers run`"
        )
        return [(UNKNOWN, needed)] * 3
    source = "held-out runs straight on and on the spot"
    return [(pair, source) for pair in zip(before, after, strict=True)]


def _field_of_view(files: CalibrationFiles) -> tuple[Pair, str]:
    camera = files.camera
    if camera is None:
        return UNKNOWN, "needs camera.toml: `workstation calibrate camera PHOTOS`"
    # The geometric mean of both axes, of the tangents of half the view.
    shares = [
        math.sqrt(one.width_px / one.focal_x_px * one.height_px / one.focal_y_px)
        for one in (camera, RobotParameters().camera)
    ]
    # What remains, at the edge of the view, where a wrong focal length shows most.
    remaining = 1 + camera.reprojection_error_px / (camera.width_px / 2)
    source = "camera.toml; what remains: at most the reprojection error, at the view's edge"
    return (shares[0] / shares[1], remaining), source


def _pitch(files: CalibrationFiles) -> tuple[Pair, str]:
    mount = files.body.camera_mount if files.body is not None else None
    if mount is None:
        needed = "needs camera_mount in body.toml: `workstation calibrate body COMPONENTS.toml`"
        return UNKNOWN, needed
    away_deg = mount.pitch_down_deg - RobotParameters().camera_mount.pitch_down_deg
    return (away_deg, None), "body.toml, by hand; nothing checks what remains"


def _latency(files: CalibrationFiles) -> tuple[Pair, str]:
    motion = files.motion
    if motion is None:
        return UNKNOWN, "needs motion.toml: `workstation identify RECORDING`"
    if "latency_ms" in motion.undetermined:
        return UNKNOWN, f"not identified: {motion.undetermined['latency_ms']}"
    agrees = KNOWN.camera_latency_ms
    value = agrees + motion.latency_ms - KNOWN.action_latency_ms
    interval = motion.intervals.get("latency_ms")
    if interval is None:
        return (value, None), "motion.toml, from command to wheels; nothing checks what remains"
    source = "motion.toml, from command to wheels; what remains: half its 95 % interval"
    return (value, agrees + (interval.high - interval.low) / 2), source


def _exposure(files: CalibrationFiles) -> tuple[Pair, str]:
    light = files.light
    if light is None:
        return UNKNOWN, "needs light.toml: `workstation calibrate light PHOTOS`"
    remaining = _level(GRAY_CARD_L + light.delta_e_after) / _level(GRAY_CARD_L)
    source = "light.toml; what remains: the gray card's ΔE, if all of it were brightness"
    return (light.exposure_gain, remaining), source


def _level(lightness: float) -> float:
    """The sRGB level of a CIELAB lightness above 8, as a share of white's."""
    luminance = ((lightness + 16) / 116) ** 3
    return 1.055 * luminance ** (1 / 2.4) - 0.055
