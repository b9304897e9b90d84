"""Picture files: read as the sensor read them out, and written."""

import logging
import os
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np
from PIL import Image, ImageOps
from PIL.TiffImagePlugin import TILELENGTH, TILEWIDTH, TiffImageFile

from mbot_protocol.beat.beat import Beat
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.git_lfs import refuse_pointer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")

logging.getLogger("PIL").setLevel(logging.CRITICAL)  # what is wrong is said once, by us

_MUTED = threading.Lock()
"""Two at a time would put back what the other has put there."""

_FORMATS = ("JPEG", "PNG", "BMP", "TIFF", "WEBP")

MOST_PIXELS = cast(int, Image.MAX_IMAGE_PIXELS)
"""Pillow's limit, 256 MB of colours. A few kB of PNG can hold a thousand times as much."""

MOST_SCANNED = 10 * MOST_PIXELS
"""Pixels over all scans of a progressive JPEG, each of which goes over all of them: libjpeg's own
script makes ten."""


def decode_picture(encoded: bytes, *, turn: bool = False) -> Picture | None:
    """A picture file's content. Shape (height, width, 3), RGB; None if it is none.

    Every picture of whatever origin is decoded here, its size being looked at first. By Pillow:
    below OpenCV libjpeg and libpng write on the screen, and what is damaged is shown in part.

    Args:
        encoded: of one of the `PICTURE_SUFFIXES`.
        turn: as a phone's orientation tag says; not where the sensor itself is calibrated.

    Raises:
        ConfigurationError: it has more than `MOST_PIXELS`.

    """
    image = _opened(encoded)
    if image is None:
        return None
    try:
        with warnings.catch_warnings(), _mute() if image.format == "TIFF" else nullcontext():
            warnings.simplefilter("ignore")
            shown = ImageOps.exif_transpose(image) if turn else image
            if shown.mode.startswith("I;16"):  # which `convert` would clip
                return np.repeat((np.asarray(shown) >> 8).astype(np.uint8)[..., None], 3, axis=2)
            return np.array(shown.convert("RGB"))
    except Exception:  # Pillow's readers raise whatever broken data lead to
        return None


def observation(beat: Beat) -> Picture | None:
    """What the policy saw in a recorded beat, shape (64, 64, 3), RGB.

    Raises:
        ConfigurationError: it is too large to be anything that a policy sees.

    """
    try:
        return decode_picture(beat.encoded)
    except ConfigurationError as error:
        number = beat.decision.sequence
        raise ConfigurationError(f"beat {number} of the recording: {error}") from None


@contextmanager
def _mute() -> Iterator[None]:
    """Nothing reaches the screen: libtiff writes there itself."""
    with _MUTED, Path(os.devnull).open("wb") as nowhere:
        kept = os.dup(2)
        os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def read_xmp(encoded: bytes) -> bytes:
    """The XML that cameras and stitchers write into a picture file; empty if there is none.

    Raises:
        ConfigurationError: the picture has more than `MOST_PIXELS`.

    """
    image = _opened(encoded)
    told = "" if image is None else image.info.get("xmp", "")
    return told.encode() if isinstance(told, str) else bytes(told)


def _opened(encoded: bytes) -> Image.Image | None:
    """Its header, and nothing decoded; None if it is no picture."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(BytesIO(encoded), formats=_FORMATS)
        scans = encoded.count(b"\xff\xda") if image.format == "JPEG" else 1
        tile = image.tag_v2 if isinstance(image, TiffImageFile) else {}
        tile_pixels = tile.get(TILEWIDTH, 1) * tile.get(TILELENGTH, 1)
        if tile_pixels > MOST_PIXELS or scans * image.width * image.height > MOST_SCANNED:
            raise Image.DecompressionBombError
        return image
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise ConfigurationError(
            f"the picture has more than {MOST_PIXELS:,} pixels, or hundreds of scans; save it again"
        ) from None
    except Exception:  # Pillow's readers raise whatever a broken header leads to
        return None


def read_picture(path: Path, *, turn: bool = False) -> Picture:
    """A picture file; as `decode_picture`.

    Raises:
        ConfigurationError: it can't be read, is not a picture or is too large.

    """
    try:
        content = path.read_bytes()
        refuse_pointer(path, content)
        picture = decode_picture(content, turn=turn)
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    except ValueError:  # a name with a zero in it, out of a table
        raise ConfigurationError(f"can't read {str(path)!r}: no name of a file") from None
    except ConfigurationError as error:
        raise ConfigurationError(f"can't take {path}: {error}") from None
    if picture is None:
        raise ConfigurationError(
            f"{path} is not a picture that can be decoded; save it as PNG or JPEG"
        )
    return picture


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


def encode_picture(picture: Picture, suffix: str, quality: int = 95) -> bytes:
    """A picture, RGB, as the bytes of a file that ends in .png or .jpg; the quality is a JPEG's."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if suffix == ".jpg" else []
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    return cast(bytes, cv2.imencode(suffix, bgr, options)[1].tobytes())


def write_picture(path: Path, picture: Picture, quality: int = 95) -> Path:
    """Write a PNG or JPEG, whole or not at all; its folder is made if need be.

    Raises:
        ConfigurationError: it can't be written.

    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    atomic_file.save(path, encode_picture(picture, path.suffix, quality))
    return path


def save_figure(figure: "Figure", path: Path, dots_per_inch: int = 110) -> None:
    """Write a figure, whole or not at all; the file's ending says in which of matplotlib's formats.

    Raises:
        ConfigurationError: it can't be written.

    """
    import io

    drawn = io.BytesIO()
    try:
        figure.savefig(drawn, format=path.suffix[1:] or "png", dpi=dots_per_inch)
    except ValueError as error:
        raise ConfigurationError(f"can't write {path}: {error}") from None
    atomic_file.save(path, drawn.getvalue())
