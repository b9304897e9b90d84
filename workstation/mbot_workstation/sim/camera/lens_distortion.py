"""A real lens's distortion, put on a picture that was drawn with a pinhole camera.

The pinhole has to see a little more than the lens where the lens bends rays outwards, so it is
chosen to cover every pixel of the distorted picture.
"""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture


def rays(camera: CameraModel, pixels: NDArray[np.float32]) -> NDArray[np.float64]:
    """Directions through pixels as slopes x/z, y/z. Shape (n, 2) in and out."""
    slopes = cv2.undistortPoints(
        pixels.reshape(-1, 1, 2), camera.matrix, np.array(camera.distortion)
    )
    return np.asarray(slopes, np.float64).reshape(-1, 2)


def covering_pinhole(camera: CameraModel) -> CameraModel:
    """The smallest pinhole camera, at the same focal length, that sees all the camera sees.

    A camera without distortion is returned as it is.
    """
    if not any(camera.distortion):
        return camera
    across = np.linspace(-0.5, camera.width_px - 0.5, 33, dtype=np.float32)
    down = np.linspace(-0.5, camera.height_px - 0.5, 33, dtype=np.float32)
    edge = np.concatenate(
        [np.stack(np.broadcast_arrays(across, y), axis=-1) for y in down[[0, -1]]]
        + [np.stack(np.broadcast_arrays(x, down), axis=-1) for x in across[[0, -1]]]
    )
    slopes = rays(camera, edge) * (camera.focal_x_px, camera.focal_y_px)
    left, top = np.ceil(-slopes.min(axis=0))
    right, bottom = np.ceil(slopes.max(axis=0))
    return CameraModel(
        width_px=int(left + right),
        height_px=int(top + bottom),
        focal_x_px=camera.focal_x_px,
        focal_y_px=camera.focal_y_px,
        principal_x_px=left - 0.5,
        principal_y_px=top - 0.5,
    )


class LensDistortion:
    """Turns pictures of the covering pinhole into pictures of the camera.

    Attributes:
        drawn: the pinhole camera to draw with, at the size to draw.

    """

    def __init__(self, camera: CameraModel, width_px: int, height_px: int) -> None:
        """Prepare for pictures of one size.

        Args:
            camera: at any size; its own covering pinhole is the one in the MuJoCo model, which
                sees the same at every size it is drawn at. One chosen for this size would
                be a fraction of a pixel wider or narrower.
            width_px, height_px: of the pictures, the whole view of the camera.

        """
        wide = covering_pinhole(camera)
        pinhole = wide.scaled_to(
            round(width_px * wide.width_px / camera.width_px),
            round(height_px * wide.height_px / camera.height_px),
        )
        camera = camera.scaled_to(width_px, height_px)
        self.drawn = pinhole
        self._maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        if any(camera.distortion):
            columns, rows = np.meshgrid(
                np.arange(camera.width_px, dtype=np.float32),
                np.arange(camera.height_px, dtype=np.float32),
            )
            slopes = rays(camera, np.stack([columns, rows], axis=-1).reshape(-1, 2))
            slopes = slopes.reshape(camera.height_px, camera.width_px, 2)
            self._maps = (
                (slopes[..., 0] * pinhole.focal_x_px + pinhole.principal_x_px).astype(np.float32),
                (slopes[..., 1] * pinhole.focal_y_px + pinhole.principal_y_px).astype(np.float32),
            )

    def apply(self, picture: Picture) -> Picture:
        """The camera's picture from the pinhole's; the same object when nothing is distorted."""
        if self._maps is None:
            return picture
        return cast(
            Picture,
            cv2.remap(picture, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        )
