"""Camera calibration on photographs of a real board, beside OpenCV's own.

python benchmarks/camera.py FOLDER... [--inner-corners 9x6] [-o docs/results/camera.md]

Real ones, by two cameras, come with the Debian package opencv-doc: examples/data/left01.jpg to
left14.jpg and right01.jpg to right14.jpg; put each camera's in a folder.
"""

import argparse
import shlex
import sys
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from machine import machine
from numpy.typing import NDArray

from mbot_workstation.learn.evaluation.provenance import provenance
from mbot_workstation.measure.calibration.camera.board_detection import Sighting
from mbot_workstation.measure.calibration.camera.camera_fit import fit_camera
from mbot_workstation.measure.calibration.camera.camera_pictures import look_for_boards
from mbot_workstation.measure.calibration.camera.picture_sizes import ScaledBoard, error_px
from mbot_workstation.measure.targets.specifications import Board

Corners = NDArray[np.float32]

STOP = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-3)


@dataclass(frozen=True)
class Result:
    """Of one way to calibrate.

    Attributes:
        pictures: fitted, of all.
        error_px: root mean square distance of the corners it was fitted to.
        held_out_px: likewise of each picture, the median, under a camera that was fitted to the
            others.
        focal_px: along x and y.
        principal_px: from the left and the top.

    """

    pictures: str
    error_px: float
    held_out_px: float
    focal_px: tuple[float, float]
    principal_px: tuple[float, float]


def opencv_corners(path: Path, size: tuple[int, int]) -> Corners | None:
    """As OpenCV's own sample does it. Shape (n, 2)."""
    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert grey is not None
    found, corners = cv2.findChessboardCorners(grey, size)
    if not found:
        return None
    return np.asarray(
        cv2.cornerSubPix(grey, corners, (11, 11), (-1, -1), STOP), np.float32
    ).reshape(-1, 2)


def by_opencv(paths: list[Path], board: Board) -> Result:
    seen = [opencv_corners(path, board.inner_corners) for path in paths]
    some = [corners for corners in seen if corners is not None]
    shape = cv2.imread(str(paths[0]), cv2.IMREAD_GRAYSCALE).shape  # pyright: ignore
    points = board.corner_points()

    def fit(chosen: list[Corners]) -> tuple[float, Any, Any]:
        start: Any = (None, None)
        error, matrix, lens, *_ = cv2.calibrateCamera(
            [points] * len(chosen), chosen, shape[::-1], *start
        )
        return error, matrix, lens

    error, matrix, _ = fit(some)
    held_out = []
    for index, corners in enumerate(some):
        _, others, bent = fit([*some[:index], *some[index + 1 :]])
        _, turn, way = cv2.solvePnP(points, corners, others, bent)
        there, _ = cv2.projectPoints(points, turn, way, others, bent)
        off = there.reshape(-1, 2) - corners
        held_out.append(float(np.sqrt((off**2).sum(axis=1).mean())))
    return Result(
        f"{len(some)} of {len(paths)}",
        error,
        float(np.median(held_out)),
        (matrix[0, 0], matrix[1, 1]),
        (matrix[0, 2], matrix[1, 2]),
    )


def by_ours(sightings: list[Sighting], paths: list[Path], *, keep_outliers: bool) -> Result:
    fit = fit_camera(sightings, keep_outliers=keep_outliers)
    kept = [one.sighting for one in fit.pictures if one.kept]
    held_out = []
    for index, left_out in enumerate(kept):
        others = fit_camera([*kept[:index], *kept[index + 1 :]], keep_outliers=True)
        seen = ScaledBoard.of(left_out, others.camera.width_px, others.camera.height_px)
        held_out.append(error_px(seen, others.camera))
    camera = fit.camera
    return Result(
        f"{len(kept)} of {len(paths)}",
        fit.error_px,
        float(np.median(held_out)),
        (camera.focal_x_px, camera.focal_y_px),
        (camera.principal_x_px, camera.principal_y_px),
    )


def page(results: dict[str, dict[str, Result]], command: str) -> str:
    lines = [
        "# Camera calibration on real photographs",
        "",
        f"Made by `{command}` on {date.today().isoformat()}: {machine()}, OpenCV "
        f"{cv2.__version__}.",
        "",
        provenance([]),
        "",
        "`left` and `right` are photographs of a real, printed checkerboard in a hand, from the",
        "Debian package opencv-doc: two cameras with a distorting lens, 640 x 480. OpenCV's own is",
        "what its sample does: findChessboardCorners, cornerSubPix, calibrateCamera. Errors are",
        "root mean square distances in pixels; held out is the median of pictures seen by a camera",
        "that was fitted to all the others.",
        "",
        "| photographs | calibrated by | pictures | error, px | held out, px | focal length, px | "
        "axis, px |",
        "|---|---|---|---|---|---|---|",
    ]
    for folder, ways in results.items():
        for way, one in ways.items():
            lines.append(
                f"| {folder} | {way} | {one.pictures} | {one.error_px:.3f} | "
                f"{one.held_out_px:.3f} | {one.focal_px[0]:.1f}, {one.focal_px[1]:.1f} | "
                f"{one.principal_px[0]:.1f}, {one.principal_px[1]:.1f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--inner-corners", default="9x6", metavar="COLUMNSxROWS")
    parser.add_argument("-o", "--output", type=Path, help="write the table to this file")
    options = parser.parse_args()
    columns, rows = (int(number) for number in options.inner_corners.split("x"))
    board = Board(columns + 1, rows + 1)
    results: dict[str, dict[str, Result]] = {}
    for folder in options.folders:
        paths = sorted(path for path in folder.iterdir() if path.suffix in {".jpg", ".png"})
        sightings = list(look_for_boards(paths, [board]).sightings)
        results[folder.name] = {
            "OpenCV": by_opencv(paths, board),
            "`calibrate camera --keep-outliers`": by_ours(sightings, paths, keep_outliers=True),
            "`calibrate camera`": by_ours(sightings, paths, keep_outliers=False),
        }
    command = ["python", "benchmarks/camera.py", *(folder.name for folder in options.folders)]
    text = page(results, shlex.join(command))
    print(text)
    if options.output is not None:
        options.output.write_text(text)


if __name__ == "__main__":
    sys.exit(main())
