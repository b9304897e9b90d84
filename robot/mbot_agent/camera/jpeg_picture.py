"""A JPEG from the network made a picture: whole, and of a size that is known before decoding."""

from typing import cast

import cv2
import numpy as np

from mbot_protocol.picture import Picture

LARGEST_SIDE_PX = 8192
"""As in the configuration (camera.width_px)."""

LARGEST_PIXELS = 16 << 20
"""48 MB decoded. A few bytes can claim to be 65535 x 65535."""

_START, _END = b"\xff\xd8", b"\xff\xd9"
_FRAME_HEADERS = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of kinds of JPEG; the three are tables."""

_FLAGS = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION


class JpegError(ValueError):
    """These bytes are not a usable JPEG; the message says why."""


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Width and height in pixels, from the headers alone.

    Raises:
        JpegError: it is not a JPEG, or its headers are damaged.

    """
    at = 2
    while data.startswith(_START) and at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4])
        if marker in _FRAME_HEADERS:
            return int.from_bytes(data[at + 7 : at + 9]), int.from_bytes(data[at + 5 : at + 7])
        at += 2 + length
    raise JpegError(
        "it is not a JPEG" if not data.startswith(_START) else "its headers are damaged"
    )


def check_jpeg(data: bytes) -> tuple[int, int]:
    """Width and height of a JPEG that is whole, as far as that is known without decoding it.

    Raises:
        JpegError: it is not a JPEG, cut off or too large.

    """
    width_px, height_px = jpeg_size(data)
    if max(width_px, height_px) > LARGEST_SIDE_PX or width_px * height_px > LARGEST_PIXELS:
        raise JpegError(f"it has {width_px} x {height_px} pixels, which is too large")
    # The decoder would fill up what is missing with grey. Some cameras pad with zeros.
    if not data.rstrip(b"\0\r\n").endswith(_END):
        raise JpegError("it is cut off")
    return width_px, height_px


def decode_jpeg(data: bytes) -> Picture:
    """The picture, RGB, shape (height, width, 3).

    Raises:
        JpegError: it is not a JPEG, cut off, damaged or too large.

    """
    width_px, height_px = check_jpeg(data)
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), _FLAGS)
    except cv2.error:
        picture = None
    if picture is None or picture.shape != (height_px, width_px, 3):
        raise JpegError("it cannot be decoded")
    return cast(Picture, cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
