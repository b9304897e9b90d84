"""What `workstation calibrate camera` says about its fit."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from msgspec import structs
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from mbot_workstation.measure.calibration.camera.camera_fit import INTRINSICS, CameraFit, PictureFit
from mbot_workstation.measure.calibration.camera.camera_pictures import SeenBoards
from mbot_workstation.measure.calibration.camera.camera_quality import CameraQuality, view_deg

MOST_NAMES = 5
"""Of pictures, in a note."""


def print_table(fit: CameraFit) -> None:
    """A line a picture: what was seen in it, and how well it fits."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("picture", "size", "corners", "distance", "tilt", "error", ""):
        table.add_column(heading, justify="left" if heading in {"picture", ""} else "right")
    for picture in fit.pictures:
        row = _row(picture)
        table.add_row(
            escape(str(row["name"])),
            f"{row['width_px']} x {row['height_px']}",
            str(row["corners"]),
            f"{row['distance_m']:.2f} m",
            f"{row['tilt_deg']:.0f}°",
            f"{row['error_px']:.3f} px",
            "" if row["kept"] else "left out",
            style=None if row["kept"] else "red",
        )
    console = Console()
    console.print(table, width=None if console.is_terminal else 200)


def _row(picture: PictureFit) -> dict[str, Any]:

    facing = cv2.Rodrigues(picture.pose[:3])[0][2, 2]
    return {
        "name": picture.sighting.name,
        "width_px": picture.sighting.size[0],
        "height_px": picture.sighting.size[1],
        "corners": len(picture.residuals_px),
        "distance_m": round(float(np.linalg.norm(picture.pose[3:])), 4),
        "tilt_deg": round(float(np.degrees(np.arccos(np.clip(abs(facing), 0, 1)))), 1),
        "error_px": round(picture.error_px, 4),
        "kept": picture.kept,
    }


def print_words(seen: SeenBoards, fit: CameraFit, quality: CameraQuality) -> None:
    """The camera that fits, how surely, and what is to be said of the pictures."""
    model, sigma = fit.camera, fit.deviations
    across, up = view_deg(model)
    print(f"{' and '.join(board.name for board in seen.boards)}")
    print(
        f"{model.width_px} x {model.height_px} pixels, view {across:.2f} x {up:.2f} degrees, "
        f"error {fit.error_px:.3f} px over {len(fit.kept)} of {len(fit.pictures)} pictures"
    )
    print(
        f"focal length {model.focal_x_px:.2f} +- {2 * sigma[0]:.2f}, "
        f"{model.focal_y_px:.2f} +- {2 * sigma[1]:.2f} px (95 %)"
    )
    print(
        f"optical axis at {model.principal_x_px:.2f} +- {2 * sigma[2]:.2f}, "
        f"{model.principal_y_px:.2f} +- {2 * sigma[3]:.2f} px"
    )
    names = INTRINSICS[4 : 4 + len(model.distortion)]
    parts = [
        f"{name} {value:+.5f} +- {2 * spread:.5f}"
        for name, value, spread in zip(names, model.distortion, sigma[4:], strict=True)
    ]
    print(f"distortion {', '.join(parts)}")
    if len(fit.kept) < len(fit.pictures):
        print(
            f"left out {len(fit.pictures) - len(fit.kept)} of {len(fit.pictures)} pictures, whose "
            f"errors are above {fit.limit_px:.3f} px, 3 times the median or the usual spread "
            "(--keep-outliers)"
        )
    for note in _all_notes(seen, quality):
        print(f"note: {note}")


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


def fields(
    seen: SeenBoards, fit: CameraFit, quality: CameraQuality, written: Path | None
) -> dict[str, Any]:
    """The same for programs, and where it was written."""
    return {
        "camera": structs.asdict(fit.camera),
        # strict=False: only wide lenses have all.
        "standard_deviations": dict(zip(INTRINSICS, fit.deviations.tolist(), strict=False)),
        "reprojection_error_px": fit.error_px,
        "limit_px": None if fit.limit_px == float("inf") else fit.limit_px,
        "pictures": [_row(picture) for picture in fit.pictures],
        "without_board": list(seen.without),
        "empty_areas": list(quality.empty_areas),
        "poses": quality.poses,
        "tilt_deg": quality.tilt_deg,
        "objections": list(quality.objections),
        "notes": _all_notes(seen, quality),
        "path": str(written) if written else None,
    }
