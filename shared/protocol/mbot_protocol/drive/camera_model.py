"""A pinhole camera with lens distortion: the intrinsics that both sides compute with."""

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

DISTORTION_LENGTHS = (5, 8)


class CameraModel(Struct, frozen=True, forbid_unknown_fields=True):
    """Intrinsics of a camera at one resolution, in OpenCV's conventions; in TOML by these names.

    Attributes:
        width_px, height_px: the picture these intrinsics belong to.
        focal_x_px, focal_y_px: focal lengths.
        principal_x_px, principal_y_px: principal point; the centre of the top left pixel is (0, 0).
        distortion: k1, k2, p1, p2, k3 of the Brown-Conrady model; of a wide lens also k4, k5, k6,
            OpenCV's rational model.

    Raises:
        ValueError: a value can't be.

    """

    width_px: int
    height_px: int
    focal_x_px: float
    focal_y_px: float
    principal_x_px: float
    principal_y_px: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if min(self.width_px, self.height_px) < 1:
            raise ValueError(f"picture is {self.width_px} x {self.height_px}, expected at least 1")
        if len(self.distortion) not in DISTORTION_LENGTHS:
            raise ValueError(
                f"distortion has {len(self.distortion)} numbers, expected 5 (k1, k2, p1, p2, k3) "
                "or 8 (also k4, k5, k6)"
            )
        for name in ("focal_x_px", "focal_y_px"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}, expected above 0")

    @classmethod
    def from_field_of_view(
        cls, width_px: int, height_px: int, horizontal_fov_deg: float, vertical_fov_deg: float
    ) -> "CameraModel":
        """An ideal camera: no distortion, principal point in the centre, pixels of any shape."""
        return cls(
            width_px=width_px,
            height_px=height_px,
            focal_x_px=width_px / 2 / math.tan(math.radians(horizontal_fov_deg) / 2),
            focal_y_px=height_px / 2 / math.tan(math.radians(vertical_fov_deg) / 2),
            principal_x_px=(width_px - 1) / 2,
            principal_y_px=(height_px - 1) / 2,
        )

    def scaled_to(self, width_px: int, height_px: int) -> "CameraModel":
        """The same camera read out at another resolution, the whole view kept."""
        sx, sy = width_px / self.width_px, height_px / self.height_px
        return CameraModel(
            width_px=width_px,
            height_px=height_px,
            focal_x_px=self.focal_x_px * sx,
            focal_y_px=self.focal_y_px * sy,
            principal_x_px=(self.principal_x_px + 0.5) * sx - 0.5,
            principal_y_px=(self.principal_y_px + 0.5) * sy - 0.5,
            distortion=self.distortion,
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The camera matrix. Shape (3, 3), pixels."""
        return np.array(
            [
                [self.focal_x_px, 0.0, self.principal_x_px],
                [0.0, self.focal_y_px, self.principal_y_px],
                [0.0, 0.0, 1.0],
            ]
        )


PI_CAMERA_HORIZONTAL_FOV_DEG = 55.3
PI_CAMERA_VERTICAL_FOV_DEG = 42.9
"""IMX477 (6.287 x 4.712 mm) behind a 6 mm lens, full sensor, 4:3 (data sheet)."""


def nominal_pi_camera(width_px: int, height_px: int) -> CameraModel:
    """The Pi HQ camera with the 6 mm lens, as the data sheet has it; uncalibrated."""
    return CameraModel.from_field_of_view(
        width_px, height_px, PI_CAMERA_HORIZONTAL_FOV_DEG, PI_CAMERA_VERTICAL_FOV_DEG
    )
