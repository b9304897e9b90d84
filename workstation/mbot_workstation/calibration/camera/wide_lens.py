"""Lenses so wide that five coefficients fold the picture over before its corners."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.calibration.camera.bundle import (
    WIDE_INTRINSICS,
    Adjusted,
    Values,
    View,
    error_px,
)

_DISTORTIONS = len(WIDE_INTRINSICS) - 4


def wide_fit(
    views: Sequence[View], kept: NDArray[np.bool_], start: Values, size: tuple[int, int]
) -> Adjusted:
    """Fit OpenCV's rational model, a quotient of two polynomials, which keeps rising further out.

    Args:
        views: of one camera.
        kept: which of them count.
        start: intrinsics of which focal lengths and principal point are taken.
        size: of the pictures, width and height in pixels.

    Raises:
        ConfigurationError: OpenCV finds no camera.

    """
    some = [view for view, keeps in zip(views, kept, strict=True) if keeps]
    matrix = np.array([[start[0], 0, start[2]], [0, start[1], start[3]], [0, 0, 1]])
    try:
        _, matrix, distortion, turns, places, deviations, *_ = cv2.calibrateCameraExtended(
            [view.points_m.astype(np.float32) for view in some],
            [view.corners_px.astype(np.float32) for view in some],
            size,
            matrix,
            np.zeros(_DISTORTIONS),
            flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_RATIONAL_MODEL,
        )
    except cv2.error as error:
        raise ConfigurationError(f"these pictures fit no camera: {error}") from None
    intrinsics = np.array(
        [
            *(matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]),
            *distortion.ravel()[:_DISTORTIONS],
        ]
    )
    poses: Values = np.array(
        [np.append(turn.ravel(), place.ravel()) for turn, place in zip(turns, places, strict=True)],
        np.float64,
    )
    errors = [error_px(v, intrinsics, pose) for v, pose in zip(some, poses, strict=True)]
    spread = np.asarray(deviations, np.float64).ravel()[: len(WIDE_INTRINSICS)]
    return Adjusted(intrinsics, spread, poses, np.array(errors))
