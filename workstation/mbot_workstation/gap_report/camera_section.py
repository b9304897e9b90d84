"""Lens, light and frames."""

import math
from html import escape
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from mbot_protocol.camera_model import CameraModel
from mbot_protocol.picture import Picture
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
from mbot_workstation.gap_report.elements import figure, paragraph, picture, table
from mbot_workstation.gap_report.frame_pair import FramePair
from mbot_workstation.gap_report.report import GapReport
from mbot_workstation.gap_report.simulated_view import mean_difference
from mbot_workstation.simulation.robot_parameters import RobotParameters

DRAWING_WIDTH_PX = 1100


def camera_section(report: GapReport) -> str:
    """HTML."""
    return "".join(
        [
            "<h2>The same frame, real and simulated</h2>",
            paragraph(report.frames_words, "soft"),
            *(_frames(one) for one in report.frames),
            "<h2>Camera</h2>",
            _camera(report.files),
            "<h2>Light</h2>",
            _light(report.files),
        ]
    )


def _frames(one: FramePair) -> str:
    pictures = (
        (one.real, "real", ""),
        (one.calibrated, "simulated with the calibration", _apart(one.real, one.calibrated)),
        (one.nominal, "nominal simulation", _apart(one.real, one.nominal)),
    )
    shown = "".join(figure(picture(p, name), f"{name}{words}") for p, name, words in pictures)
    return f'<div class="frames"><h3 class="title">{escape(one.title)}</h3>{shown}</div>'


def _apart(real: Picture, drawn: Picture) -> str:
    return f": {mean_difference(real, drawn):.1f} of 255 levels off on average"


def _camera(files: CalibrationFiles) -> str:
    camera, nominal = files.camera, RobotParameters().camera
    if camera is None:
        return paragraph("Not calibrated; the command is named at the top.", "soft")
    model, sheet = camera.model(), nominal.scaled_to(camera.width_px, camera.height_px)
    rows = [
        ["field of view, across", f"{_view_deg(model)[0]:.2f}°", f"{_view_deg(sheet)[0]:.2f}°"],
        ["field of view, down", f"{_view_deg(model)[1]:.2f}°", f"{_view_deg(sheet)[1]:.2f}°"],
        [
            "optical axis from the middle",
            f"{_from_middle(model)[0]:+.1f}, {_from_middle(model)[1]:+.1f} px",
            f"{_from_middle(sheet)[0]:+.1f}, {_from_middle(sheet)[1]:+.1f} px",
        ],
        [
            "distortion k1, k2, k3",
            *(
                ", ".join(f"{lens.distortion[place]:+.3f}" for place in (0, 1, 4))
                for lens in (model, sheet)
            ),
        ],
    ]
    words = (
        f"Reprojection error {camera.reprojection_error_px:.3f} px over {camera.pictures} pictures "
        f"of {camera.width_px} x {camera.height_px} ({camera.made_on}): how far a corner of the "
        "board is from where this lens would put it."
    )
    return (
        paragraph(words)
        + table(["", "calibrated", "nominal"], rows, numbers=2)
        + _drawing(Path(files.folder) / "camera.png", "the calibration's corners and errors")
    )


def _drawing(path: Path, words: str) -> str:
    """What `calibrate` drew, if it is still there."""
    drawn = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    if drawn is None:
        return ""
    height, width = drawn.shape[:2]
    if width > DRAWING_WIDTH_PX:
        size = DRAWING_WIDTH_PX, round(height * DRAWING_WIDTH_PX / width)
        drawn = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA)
    pixels = cast(Picture, cv2.cvtColor(drawn, cv2.COLOR_BGR2RGB))
    return figure(picture(pixels, words), f"From {path.name}.")


def _light(files: CalibrationFiles) -> str:
    light = files.light
    if light is None:
        return paragraph("Not calibrated; the command is named at the top.", "soft")
    words = (
        f"The gray card is {light.delta_e_before:.1f} away from the simulated one before and "
        f"{light.delta_e_after:.1f} after (CIEDE2000; 1 is just visible; {light.pictures} "
        f"pictures, {light.made_on})."
    )
    x, y, z = np.array(light.direction) / np.linalg.norm(light.direction)
    rows = [
        ["exposure", f"{light.exposure_gain:.3f}", "1"],
        ["red, blue against green", f"{light.red_gain:.3f}, {light.blue_gain:.3f}", "1, 1"],
        ["light comes from", _from_words(x, y, z), ""],
        ["light from all sides", f"{100 * light.ambient:.0f} %", ""],
    ]
    return (
        paragraph(words)
        + table(["", "calibrated", "nominal"], rows, numbers=2)
        + _drawing(Path(files.folder) / "light.png", "the gray card, real and simulated")
    )


def _from_words(x: float, y: float, z: float) -> str:
    height = math.degrees(math.asin(-z))
    side = math.degrees(math.atan2(-y, -x))
    where = "left" if side > 0 else "right"
    return f"{height:.0f}° above the horizon, {abs(side):.0f}° to the {where}"


def _view_deg(model: CameraModel) -> tuple[float, float]:
    across = 2 * math.atan(model.width_px / 2 / model.focal_x_px)
    down = 2 * math.atan(model.height_px / 2 / model.focal_y_px)
    return math.degrees(across), math.degrees(down)


def _from_middle(model: CameraModel) -> tuple[float, float]:
    right = model.principal_x_px - (model.width_px - 1) / 2
    return right, model.principal_y_px - (model.height_px - 1) / 2
