"""Where the policy's view reaches beyond the calibrated camera's frame.

`Observer` cuts the policy's field of view out of the camera's frames. A camera that sees a little
less, or not quite straight, has no pixels for its rim, and `Observer` takes the nearest ones of
the frame instead. So must the simulation, which draws the whole view.
"""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import FULL_VIEW, OBSERVATION_SIDE_PX
from mbot_workstation.sim.camera.lens_distortion import rays

UNNOTICED_PX = 0.05
"""A rim narrower than this is left out."""


class FrameEdges:
    """One camera's rim in the observations made from its frames."""

    def __init__(self, camera: CameraModel) -> None:
        """Find out which pixels of an observation have no pixels in the camera's frames."""
        side = OBSERVATION_SIDE_PX
        view = CameraModel.from_field_of_view(
            side, side, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg
        )
        columns, rows = np.meshgrid(np.arange(side, dtype=np.float64), np.arange(side))
        ahead = np.stack(
            [
                (columns.ravel() - view.principal_x_px) / view.focal_x_px,
                (rows.ravel() - view.principal_y_px) / view.focal_y_px,
                np.ones(side * side),
            ],
            axis=1,
        )
        nowhere = np.zeros(3)
        in_frame, _ = cv2.projectPoints(
            ahead, nowhere, nowhere, camera.matrix, np.array(camera.distortion)
        )
        in_frame = np.asarray(in_frame, np.float64).reshape(-1, 2)
        # Half a pixel beyond the outermost centres is still theirs.
        nearest = np.clip(in_frame, -0.5, (camera.width_px - 0.5, camera.height_px - 0.5))
        outside = (np.abs(nearest - in_frame) > 0).any(axis=1)
        taken = np.stack([columns.ravel(), rows.ravel()], axis=1)
        if outside.any():
            slopes = rays(camera, nearest[outside].astype(np.float32))
            taken[outside] = slopes * (view.focal_x_px, view.focal_y_px) + (
                view.principal_x_px,
                view.principal_y_px,
            )
        shift_px = np.abs(taken - np.stack([columns.ravel(), rows.ravel()], axis=1)).max()
        self._maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        if shift_px > UNNOTICED_PX:
            columns_taken, rows_taken = taken.astype(np.float32).T.reshape(2, side, side)
            self._maps = np.ascontiguousarray(columns_taken), np.ascontiguousarray(rows_taken)

    @property
    def are_in_view(self) -> bool:
        """Whether an observation shows them at all."""
        return self._maps is not None

    def apply(self, observation: Picture) -> Picture:
        """The observation with its rim as the frame's edge pixels; itself if it has no rim."""
        if self._maps is None:
            return observation
        return cast(
            Picture,
            cv2.remap(observation, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        )
