"""A plane before a camera, and where on it a pixel lies."""

from dataclasses import dataclass

import cv2
import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_workstation.sim.track import Array


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlane:
    """A level plane below a camera, with a frame of its own: z up, origin straight below the
    camera, x to the right in the picture.

    Attributes:
        up: unit vector in the camera's frame (x right, y down, z ahead), shape (3,).
        distance_m: from the camera straight down.

    """

    up: Array
    distance_m: float

    @property
    def axes(self) -> Array:
        """The plane's x and y in the camera's frame. Shape (2, 3)."""
        right = np.array([1.0, 0.0, 0.0])
        x = right - (right @ self.up) * self.up
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(self.up, x)])

    def raised(self, height_m: float) -> "FloorPlane":
        """The plane so far above this one; its frame lies straight above."""
        return FloorPlane(self.up, self.distance_m - height_m)

    def places_m(self, rays: Array) -> Array:
        """Where rays from the camera meet the plane, in its frame. Shapes (..., 3), (..., 2).

        Rays that never meet it give places that are not finite.
        """
        falling = rays @ self.up
        with np.errstate(divide="ignore", invalid="ignore"):
            along = np.where(falling < 0, -self.distance_m / falling, np.nan)
        points = rays * along[..., None]
        return points @ self.axes.T


def pixel_rays(camera: CameraModel, pixels: Array) -> Array:
    """Directions in the camera's frame, 1 ahead. Shapes (..., 2), (..., 3)."""
    flat = pixels.reshape(-1, 1, 2)
    straight = cv2.undistortPoints(flat, camera.matrix, np.array(camera.distortion)).reshape(-1, 2)
    rays = np.concatenate([straight, np.ones((len(straight), 1))], axis=1)
    return rays.astype(np.float64).reshape(*pixels.shape[:-1], 3)


def plane_from_points(camera: CameraModel, points_m: Array, pixels: Array) -> FloorPlane | None:
    """The plane z = 0 of known points; None if no pose fits.

    Args:
        camera: that sees them.
        points_m: on the plane, shape (n, 2), n at least 4, any frame.
        pixels: where they are seen, shape (n, 2).

    """
    objects = np.concatenate([points_m, np.zeros((len(points_m), 1))], axis=1)
    solved, turned, moved = cv2.solvePnP(
        objects, pixels, camera.matrix, np.array(camera.distortion), flags=cv2.SOLVEPNP_ITERATIVE
    )
    if not solved:
        return None
    matrix, _ = cv2.Rodrigues(turned)
    normal, place = np.asarray(matrix)[:, 2], np.asarray(moved).ravel()
    # Up is towards the camera, whichever way the points' own z goes.
    distance_m = float(-normal @ place)
    return FloorPlane(normal * np.sign(distance_m), abs(distance_m)) if distance_m else None
