"""The picture pipeline: a camera frame -> the policy's 64 x 64 RGB observation.

The robot and the virtual robot's daemon call `Observer`. Training renders the policy's field of
view directly; a test holds the two to the same rays.
"""

import math
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ContractError
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX, FieldOfView

Picture = NDArray[np.uint8]
"""Shape (height, width, 3), RGB."""


class Observer:
    """Maps frames of one camera onto one policy's field of view.

    Lens distortion is undone and the policy's view cut out in one bilinear remap at about the
    frame's own density, then every observation pixel becomes the mean of the area it covers.
    Rays outside the frame take the nearest edge pixel.
    """

    def __init__(self, camera: CameraModel, view: FieldOfView) -> None:
        self._shape = (camera.height_px, camera.width_px, 3)
        ideal = CameraModel.from_field_of_view(
            OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, view.horizontal_deg, view.vertical_deg
        )
        samples = max(
            1,
            math.ceil(camera.focal_x_px / ideal.focal_x_px - 1e-3),
            math.ceil(camera.focal_y_px / ideal.focal_y_px - 1e-3),
        )
        side = OBSERVATION_SIDE_PX * samples
        self._map_x, self._map_y = cv2.initUndistortRectifyMap(
            camera.matrix,
            np.array(camera.distortion),
            np.eye(3),
            ideal.scaled_to(side, side).matrix,
            (side, side),
            cv2.CV_16SC2,
        )

    def observe(self, frame: Picture) -> Picture:
        """Cut the policy's view out of a frame.

        Args:
            frame: shape (height_px, width_px, 3) of the camera, uint8, RGB.

        Returns:
            Shape (64, 64, 3), uint8, RGB.

        Raises:
            ContractError: the frame has another shape or type.

        """
        if frame.shape != self._shape or frame.dtype != np.uint8:
            raise ContractError(
                f"frame is {frame.dtype} {frame.shape}, expected uint8 {self._shape}; "
                "set camera.width_px and camera.height_px to what the camera delivers"
            )
        undistorted = cv2.remap(
            frame, self._map_x, self._map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        side = OBSERVATION_SIDE_PX
        return cast(Picture, cv2.resize(undistorted, (side, side), interpolation=cv2.INTER_AREA))
