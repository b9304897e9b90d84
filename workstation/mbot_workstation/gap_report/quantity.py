"""The quantities a policy may stumble over: what they are on this robot, and how it is known."""

import math
from dataclasses import dataclass

from mbot_protocol.calibration import CameraCalibration
from mbot_protocol.camera_model import CameraModel
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
from mbot_workstation.gap_report.deviation import Deviation
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.variation.presets import measured

DEVIATIONS_OF_QUANTITIES = (
    "gain asymmetry",
    "track_scale",
    "wheel_radius_scale",
    "fov_scale",
    "camera_pitch_deg",
    "camera_latency_ms",
    "exposure_gain",
)
"""The axes of tolerance maps, as in `study_plans.DEVIATIONS`, in the order of `quantities`."""

GRAY_CARD_L = 49.5
"""CIELAB lightness of an 18 % gray card."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One of them, in the values of its tolerance map's axis.

    Attributes:
        title: for people.
        deviation: the axis's name, as in `study_plans.DEVIATIONS`.
        unit: of the values as shown.
        factor, offset: shown = factor * (value - offset).
        nominal: the value at which simulation and robot agree.
        uncalibrated: this robot, seen from the nominal simulation; None if not known.
        calibrated: this robot, seen from its calibrated simulation; None if not known.
        source: where the two come from, or what has to be done to know them.

    """

    title: str
    deviation: str
    unit: str
    factor: float
    offset: float
    nominal: float
    uncalibrated: float | None
    calibrated: float | None
    source: str

    def words(self, value: float) -> str:
        """A value as shown, such as "+3.1 %"."""
        shown = self.factor * (value - self.offset)
        digits = 0 if abs(shown) >= 20 else 1 if abs(shown) >= 1 else 2
        text = f"{shown:+.{digits}f}"
        if float(text) == 0:
            text = "0"
        return f"{text} {self.unit}".replace(" °", "°")


def quantities(
    files: CalibrationFiles, before: Deviation | None, after: Deviation | None
) -> tuple[Quantity, ...]:
    """All seven.

    Args:
        files: the robot's calibration.
        before, after: held-out driving against the nominal and the calibrated simulation.

    """
    return (
        *_driving(before, after),
        _field_of_view(files.camera),
        _pitch(files),
        _latency(files),
        _exposure(files),
    )


def _driving(before: Deviation | None, after: Deviation | None) -> tuple[Quantity, ...]:
    source = "held-out runs straight on and on the spot"
    if before is None:
        source = (
            "needs runs of forward-forward or backward-backward and of forward-backward or "
            "backward-forward: `workstation maneuvers run`"
        )
    rows = (
        ("Gain asymmetry", "gain asymmetry", 0.0, "asymmetry"),
        ("Track", "track_scale", 1.0, "track_scale"),
        ("Wheel radius (effective)", "wheel_radius_scale", 1.0, "radius_scale"),
    )
    return tuple(
        Quantity(
            title=title,
            deviation=axis,
            unit="%",
            factor=100.0,
            offset=agrees,
            nominal=agrees,
            uncalibrated=None if before is None else getattr(before, field),
            calibrated=None if after is None else getattr(after, field),
            source=source,
        )
        for title, axis, agrees, field in rows
    )


def _field_of_view(camera: CameraCalibration | None) -> Quantity:
    scale = remaining = None
    source = "needs camera.toml: `workstation calibrate camera PHOTOS`"
    if camera is not None:
        scale = _view_share(camera.model()) / _view_share(RobotParameters().camera)
        # At the edge of the view, where a wrong focal length shows most.
        remaining = 1 + camera.reprojection_error_px / (camera.width_px / 2)
        source = "camera.toml; what remains: at most the reprojection error, at the view's edge"
    return Quantity("Field of view", "fov_scale", "%", 100.0, 1.0, 1.0, scale, remaining, source)


def _view_share(camera: CameraModel) -> float:
    """Tangent of half the view, the geometric mean of both axes, but for a factor."""
    return math.sqrt(camera.width_px / camera.focal_x_px * camera.height_px / camera.focal_y_px)


def _pitch(files: CalibrationFiles) -> Quantity:
    mount = files.body.camera_mount if files.body is not None else None
    nominal = RobotParameters().camera_mount.pitch_down_deg
    away = None if mount is None else mount.pitch_down_deg - nominal
    source = "body.toml, by hand; nothing checks what remains"
    if mount is None:
        source = "needs camera_mount in body.toml: `workstation calibrate body COMPONENTS.toml`"
    return Quantity("Mounting pitch", "camera_pitch_deg", "°", 1.0, 0.0, 0.0, away, None, source)


def _latency(files: CalibrationFiles) -> Quantity:
    nominal = measured()
    agrees = nominal.camera_latency_ms
    value = remaining = None
    source = "needs motion.toml: `workstation identify RECORDING`"
    if files.motion is not None:
        value = agrees + files.motion.latency_ms - nominal.action_latency_ms
        source = "motion.toml, from command to wheels; nothing checks what remains"
        interval = files.motion.intervals.get("latency_ms")
        if interval is not None:
            remaining = agrees + (interval.high - interval.low) / 2
            source = "motion.toml, from command to wheels; what remains: half its 95 % interval"
        if "latency_ms" in files.motion.undetermined:
            value = remaining = None
            source = f"not identified: {files.motion.undetermined['latency_ms']}"
    return Quantity(
        "Latency", "camera_latency_ms", "ms", 1.0, agrees, agrees, value, remaining, source
    )


def _exposure(files: CalibrationFiles) -> Quantity:
    value = remaining = None
    source = "needs light.toml: `workstation calibrate light PHOTOS`"
    if files.light is not None:
        value = files.light.exposure_gain
        lighter = GRAY_CARD_L + files.light.delta_e_after
        remaining = _level(lighter) / _level(GRAY_CARD_L)
        source = "light.toml; what remains: the gray card's ΔE, if all of it were brightness"
    return Quantity("Exposure", "exposure_gain", "%", 100.0, 1.0, 1.0, value, remaining, source)


def _level(lightness: float) -> float:
    """The sRGB level of a CIELAB lightness above 8, as a share of white's."""
    luminance = ((lightness + 16) / 116) ** 3
    return 1.055 * luminance ** (1 / 2.4) - 0.055
