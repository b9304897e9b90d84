"""The result of a camera's calibration: what is written, and what is said of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import cv2
import numpy as np

from mbot_protocol.drive.calibration import CameraCalibration
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.camera.camera_drawing import draw_calibration
from mbot_workstation.measure.calibration.camera.camera_fit import INTRINSICS, CameraFit, PictureFit
from mbot_workstation.measure.calibration.camera.camera_pictures import SeenBoards
from mbot_workstation.measure.calibration.camera.camera_quality import CameraQuality, view_deg
from mbot_workstation.sim.calibrated.calibration_folder import write_camera

MOST_NAMES = 5
"""Of pictures, in a note."""


@dataclass(frozen=True, slots=True)
class FittedPicture:
    """A picture with a board: how it was taken, and how well it fits; kept if it counts."""

    name: str
    width_px: int
    height_px: int
    corners: int
    distance_m: float
    tilt_deg: float
    error_px: float
    kept: bool

    @classmethod
    def of(cls, picture: PictureFit) -> "FittedPicture":
        """From its fit."""
        facing = cv2.Rodrigues(picture.pose[:3])[0][2, 2]
        return cls(
            picture.sighting.name,
            *picture.sighting.size,
            corners=len(picture.residuals_px),
            distance_m=round(float(np.linalg.norm(picture.pose[3:])), 4),
            tilt_deg=round(float(np.degrees(np.arccos(np.clip(abs(facing), 0, 1)))), 1),
            error_px=round(picture.error_px, 4),
            kept=picture.kept,
        )


@dataclass(frozen=True, slots=True)
class CameraResult:
    """The camera that fits, how surely, and what is to be said of the pictures.

    Attributes:
        standard_deviations: of the intrinsics, by name.
        limit_px: pictures with a larger error were left out; None if none can be.
        poses, tilt_deg, empty_areas, objections: as of `CameraQuality`.
        path: of the calibration; None if it was refused.

    """

    camera: CameraModel
    standard_deviations: dict[str, float]
    reprojection_error_px: float
    limit_px: float | None
    pictures: list[FittedPicture]
    without_board: Sequence[str]
    empty_areas: Sequence[str]
    poses: int
    tilt_deg: float
    objections: Sequence[str]
    notes: list[str]
    path: Path | None


def camera_result(
    seen: SeenBoards, fit: CameraFit, quality: CameraQuality, path: Path | None
) -> CameraResult:
    """All of a calibration in one value."""
    return CameraResult(
        camera=fit.camera,
        # strict=False: only wide lenses have all.
        standard_deviations=dict(zip(INTRINSICS, fit.deviations.tolist(), strict=False)),
        reprojection_error_px=fit.error_px,
        limit_px=None if fit.limit_px == float("inf") else fit.limit_px,
        pictures=[FittedPicture.of(picture) for picture in fit.pictures],
        without_board=seen.without,
        empty_areas=quality.empty_areas,
        poses=quality.poses,
        tilt_deg=quality.tilt_deg,
        objections=quality.objections,
        notes=_all_notes(seen, quality),
        path=path,
    )


def save_camera(fit: CameraFit, folder: Path, *, refused: bool) -> tuple[Path | None, Path]:
    """Write camera.toml, unless it is refused, and draw the pictures' errors.

    Returns:
        The file, if it was written, and the drawing.

    Raises:
        ConfigurationError: no usable camera, or a file can't be written.

    """
    written = None if refused else write_camera(folder, _calibration(fit))
    drawing = folder / ("camera-refused.png" if refused else "camera.png")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't write {drawing}: {error.strerror}") from None
    draw_calibration(fit, drawing)
    return written, drawing


def _calibration(fit: CameraFit) -> CameraCalibration:
    model = fit.camera
    try:
        return CameraCalibration(
            width_px=model.width_px,
            height_px=model.height_px,
            focal_x_px=model.focal_x_px,
            focal_y_px=model.focal_y_px,
            principal_x_px=model.principal_x_px,
            principal_y_px=model.principal_y_px,
            distortion=model.distortion,
            reprojection_error_px=fit.error_px,
            pictures=len(fit.kept),
            made_on=datetime.now().astimezone().date().isoformat(),
        )
    except ValueError as error:
        raise ConfigurationError(f"these pictures fit no usable camera: {error}") from None


def camera_lines(seen: SeenBoards, fit: CameraFit, quality: CameraQuality) -> Iterator[str]:
    """For people: the camera that fits, how surely, and what is to be said of the pictures."""
    model, sigma = fit.camera, fit.deviations
    across, up = view_deg(model)
    yield " and ".join(board.name for board in seen.boards)
    yield (
        f"{model.width_px} x {model.height_px} pixels, view {across:.2f} x {up:.2f} degrees, "
        f"error {fit.error_px:.3f} px over {len(fit.kept)} of {len(fit.pictures)} pictures"
    )
    yield (
        f"focal length {model.focal_x_px:.2f} +- {2 * sigma[0]:.2f}, "
        f"{model.focal_y_px:.2f} +- {2 * sigma[1]:.2f} px (95 %)"
    )
    yield (
        f"optical axis at {model.principal_x_px:.2f} +- {2 * sigma[2]:.2f}, "
        f"{model.principal_y_px:.2f} +- {2 * sigma[3]:.2f} px"
    )
    names = INTRINSICS[4 : 4 + len(model.distortion)]
    parts = [
        f"{name} {value:+.5f} +- {2 * spread:.5f}"
        for name, value, spread in zip(names, model.distortion, sigma[4:], strict=True)
    ]
    yield f"distortion {', '.join(parts)}"
    if len(fit.kept) < len(fit.pictures):
        yield (
            f"left out {len(fit.pictures) - len(fit.kept)} of {len(fit.pictures)} pictures, whose "
            f"errors are above {fit.limit_px:.3f} px, 3 times the median or the usual spread "
            "(--keep-outliers)"
        )
    for note in _all_notes(seen, quality):
        yield f"note: {note}"


def _all_notes(seen: SeenBoards, quality: CameraQuality) -> list[str]:
    notes = list(quality.notes)
    if seen.unreadable:
        notes.append(f"left out, not pictures: {_few(seen.unreadable)}")
    if seen.without:
        notes.append(f"no board found in {_few(seen.without)}")
    notes += [
        f"a {board.name} is its own mirror image: whether the camera mirrors its pictures can't be "
        "told; with an even number of squares both ways, or a ChArUco board, it could"
        for board in seen.boards
        if not board.tells_mirrored
    ]
    return notes


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return ", ".join(names[:MOST_NAMES]) + more
