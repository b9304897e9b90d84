"""Picture files as the sensor read them out."""

from collections.abc import Iterable
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.picture import Picture

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")


def read_picture(path: Path, *, turn: bool = False) -> Picture:
    """A picture file. Shape (height, width, 3), RGB.

    Args:
        path: the file.
        turn: as a phone's orientation tag says; not where the sensor itself is calibrated.

    Raises:
        ConfigurationError: it can't be read or is no picture.

    """
    try:
        encoded = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    picture = decoded_picture(encoded, turn=turn)
    if picture is None:
        raise ConfigurationError(f"{path} is no picture OpenCV can decode; save it as PNG or JPEG")
    return picture


def decoded_picture(encoded: bytes, *, turn: bool = False) -> Picture | None:
    """A picture file's content, shape (height, width, 3), RGB; None if it is none. See above."""
    kind = cv2.IMREAD_COLOR if turn else cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    decoded = cv2.imdecode(np.frombuffer(encoded, np.uint8), kind) if encoded else None
    return None if decoded is None else cast(Picture, cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB))


def picture_files(given: Iterable[Path]) -> list[Path]:
    """The files themselves, and the pictures in folders among them, sorted; none twice.

    Raises:
        ConfigurationError: a folder holds no picture, or there is none at all.

    """
    found: list[Path] = []
    for path in given:
        if path.is_dir():
            inside = sorted(p for p in path.iterdir() if p.suffix.lower() in PICTURE_SUFFIXES)
            if not inside:
                raise ConfigurationError(f"folder {path} holds no pictures (PNG or JPEG)")
            found += inside
        else:
            found.append(path)
    if not found:
        raise ConfigurationError("no pictures given; name files, or a folder of them")
    return list(dict.fromkeys(found))
