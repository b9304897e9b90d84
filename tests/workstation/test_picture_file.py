"""What is a picture, and of which size, before anybody makes room for it."""

import contextlib
import random
import resource
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pictures.picture_file import (
    PICTURE_SUFFIXES,
    decode_picture,
    encode_picture,
    read_picture,
)
from tests.workstation.bombs import png_that_says

PICTURE = np.arange(24 * 32 * 3, dtype=np.uint16).reshape(24, 32, 3).astype(np.uint8)


@pytest.mark.parametrize("suffix", PICTURE_SUFFIXES)
def test_every_kind_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), PICTURE)
    shown = read_picture(path)[..., ::-1].astype(int)
    assert shown.shape == PICTURE.shape
    assert np.abs(shown - PICTURE)[4:-4, 4:-4].mean() < 30


def jpeg_that_says(width_px: int, height_px: int) -> bytes:
    jpeg = encode_picture(PICTURE, ".jpg")
    at = jpeg.index(b"\xff\xc0") + 5
    return jpeg[:at] + struct.pack(">HH", height_px, width_px) + jpeg[at + 4 :]


@pytest.mark.parametrize(
    "encoded",
    [png_that_says(20_000, 20_000), png_that_says(30_000, 15_000), jpeg_that_says(65_000, 65_000)],
)
def test_a_small_file_that_says_it_is_huge_is_refused_before_it_is_decoded(
    tmp_path: Path, encoded: bytes
) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    (tmp_path / "bomb.png").write_bytes(encoded)
    with pytest.raises(ConfigurationError, match=r"bomb.png: the picture has more than 89,478,485"):
        read_picture(tmp_path / "bomb.png")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000, "kB"


@pytest.mark.parametrize("hidden", [b"\xff\xd0\x00\x14", b"\xff\x01\x00\x14", b"\xff\xff"])
def test_no_marker_makes_the_one_who_looks_at_the_size_see_another_than_the_decoder(
    hidden: bytes,
) -> None:
    """As markers without a length did to a hand-made reader: a small header inside a segment that
    only one of the two skips."""
    jpeg, big = encode_picture(PICTURE, ".jpg"), jpeg_that_says(60_000, 60_000)
    small = jpeg[jpeg.index(b"\xff\xc0") :][:19]
    made = big[:2] + hidden + small + big[2:]
    try:
        picture = decode_picture(made)
    except ConfigurationError:
        return
    assert picture is None or picture.size < 60_000**2


def tiled_tiff(tile_px: int, tile: bytes) -> bytes:
    """Of 100 x 100 pixels in gray, in one compressed tile."""
    entries = [(256, 100), (257, 100), (258, 8), (259, 8), (262, 1), (277, 1)]
    entries += [(322, tile_px), (323, tile_px), (324, 134), (325, len(tile))]
    tags = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in entries)
    return struct.pack("<2sHIH", b"II", 42, 8, len(entries)) + tags + bytes(4) + tile


def test_a_tile_larger_than_any_picture_is_refused() -> None:
    assert decode_picture(tiled_tiff(128, zlib.compress(bytes(128**2)))) is not None
    with pytest.raises(ConfigurationError, match="more than 89,478,485"):
        decode_picture(tiled_tiff(10_000, zlib.compress(bytes(10**8))))


@pytest.mark.parametrize("suffix", PICTURE_SUFFIXES)
def test_what_is_damaged_is_told_by_nobody_but_us(
    capfd: pytest.CaptureFixture[str], suffix: str
) -> None:
    """Neither by libjpeg, libpng, libtiff, OpenCV nor Pillow."""
    noise, whole = random.Random(1), cv2.imencode(suffix, PICTURE)[1].tobytes()
    for number in range(200):
        damaged = bytearray(whole[: noise.randrange(1, len(whole))] if number % 2 else whole)
        for _ in range(4):
            damaged[noise.randrange(len(damaged))] = noise.randrange(256)
        with contextlib.suppress(ConfigurationError):
            decode_picture(bytes(damaged))
    assert capfd.readouterr() == ("", "")


def test_a_picture_in_part_is_none(capfd: pytest.CaptureFixture[str]) -> None:
    assert decode_picture(tiled_tiff(128, b"no tile")) is None
    assert decode_picture(encode_picture(PICTURE, ".jpg")[:-200]) is None
    assert capfd.readouterr() == ("", "")


def test_sixteen_bits_of_gray_are_not_clipped() -> None:
    gray = PICTURE[..., 0].astype(np.uint16) * 257
    shown = decode_picture(cv2.imencode(".png", gray)[1].tobytes())
    assert shown is not None
    assert (shown == PICTURE[..., :1]).all()


def test_what_is_none_is_none() -> None:
    whole = encode_picture(PICTURE, ".png")
    for encoded in (b"", b"GIF89a", b"#?RADIANCE\n", whole[:20], whole[8:]):
        assert decode_picture(encoded) is None
    text = zlib.compress(bytes(50_000_000))
    chunk = b"iCCP" + b"x\0\0" + text
    profile = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    decode_picture(whole[:33] + profile + whole[33:])
