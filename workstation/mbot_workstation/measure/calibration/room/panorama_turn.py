"""Turns a 360-degree photo: level, and with another direction in its middle."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture

Values = NDArray[np.float64]
"""Directions: x towards the photo's middle, y to its left, z up."""


def directions(width_px: int) -> Values:
    """Where each pixel of a panorama looks. Shape (width_px / 2, width_px, 3), unit vectors."""
    height_px = width_px // 2
    yaw = np.pi * (1 - 2 * (np.arange(width_px) + 0.5) / width_px)
    elevation = np.pi * (0.5 - (np.arange(height_px) + 0.5) / height_px)
    flat = np.cos(elevation)[:, None]
    return np.stack(
        [
            flat * np.cos(yaw),
            flat * np.sin(yaw),
            np.broadcast_to(np.sin(elevation)[:, None], (height_px, width_px)),
        ],
        axis=-1,
    )


def look_at(picture: Picture, where: Values) -> Picture:
    """Sample a panorama.

    Args:
        picture: equirectangular, shape (h, 2 h, 3).
        where: directions, shape (..., 3), of any length; two axes before the last.

    Returns:
        Shape (..., 3), uint8.

    """
    height, width = picture.shape[:2]
    yaw = np.arctan2(where[..., 1], where[..., 0])
    elevation = np.arctan2(where[..., 2], np.hypot(where[..., 0], where[..., 1]))
    margin = 2
    wrapped = cv2.copyMakeBorder(picture, 0, 0, margin, margin, cv2.BORDER_WRAP)
    columns = (1 - yaw / np.pi) * width / 2 - 0.5 + margin
    rows = (0.5 - elevation / np.pi) * height - 0.5
    return cast(
        Picture,
        cv2.remap(
            wrapped,
            columns.astype(np.float32),
            rows.astype(np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
    )


def camera_tilt(pitch_deg: float, roll_deg: float) -> Values:
    """The rotation from a tilted camera's directions to level ones. Shape (3, 3).

    Args:
        pitch_deg: how far the middle of its photo is above the horizon.
        roll_deg: how far the camera was turned clockwise, as seen from behind.

    """
    pitch, roll = np.radians([pitch_deg, roll_deg])
    up = np.array(
        [[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]]
    )
    around = np.array(
        [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    )
    return up @ around


def tilt_of(vertical: Values) -> tuple[float, float]:
    """Pitch and roll in degrees of a camera whose photo has the vertical there, shape (3,)."""
    x, y, z = vertical / np.linalg.norm(vertical)
    return float(np.degrees(np.arcsin(x))), float(np.degrees(np.arctan2(y, z)))


def level(
    picture: Picture, width_px: int, pitch_deg: float, roll_deg: float, heading_deg: float
) -> Picture:
    """A level panorama of another size.

    Args:
        picture: shape (h, 2 h, 3).
        width_px: of the result.
        pitch_deg, roll_deg: of the camera that took it, see `camera_tilt`.
        heading_deg: what is so far to the right of the middle comes into the middle.

    """
    if width_px < picture.shape[1]:
        size = (width_px, width_px // 2)
        picture = cast(Picture, cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    turn = np.radians(-heading_deg)
    about = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    back = camera_tilt(pitch_deg, roll_deg).T @ about
    if picture.shape[1] == width_px and np.allclose(back, np.eye(3)):
        return picture
    return look_at(picture, directions(width_px) @ back.T)
