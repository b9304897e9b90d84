"""JPEGs from the network: whole ones are decoded, everything else is refused."""

import contextlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.camera.jpeg_picture import JpegError, decode_jpeg, jpeg_size

PICTURE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)


def jpeg(picture: np.ndarray, *flags: int) -> bytes:
    """Of a picture in OpenCV's order of colours."""
    return cv2.imencode(".jpg", picture, flags)[1].tobytes()


@given(
    st.integers(1, 300),
    st.integers(1, 300),
    st.sampled_from([(), (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)]),
)
def test_the_size_is_known_before_decoding(
    width_px: int, height_px: int, flags: tuple[int, ...]
) -> None:
    data = jpeg(np.full((height_px, width_px, 3), 90, np.uint8), *flags)
    assert jpeg_size(data) == (width_px, height_px)
    assert decode_jpeg(data).shape == (height_px, width_px, 3)


def test_colours_are_rgb_and_grey_becomes_three() -> None:
    blue, green, red = 10, 20, 200
    picture = decode_jpeg(jpeg(np.full((48, 64, 3), (blue, green, red), np.uint8)))
    assert np.abs(picture.reshape(-1, 3).mean(0) - (red, green, blue)).max() < 3
    assert decode_jpeg(jpeg(PICTURE[..., 0])).shape == (48, 64, 3)


def test_padding_is_no_damage() -> None:
    assert decode_jpeg(jpeg(PICTURE) + b"\0\0\0\r\n").shape == (48, 64, 3)


@given(st.floats(0, 1, exclude_max=True))
def test_what_is_cut_off_is_refused(share: float) -> None:
    data = jpeg(PICTURE)
    with pytest.raises(JpegError):
        decode_jpeg(data[: int(len(data) * share)])


@pytest.mark.parametrize("size", [(65535, 65535), (8193, 16), (16, 8193), (8192, 8192), (0, 48)])
def test_a_false_size_is_refused_before_decoding(size: tuple[int, int]) -> None:
    data = bytearray(jpeg(PICTURE))
    header = data.index(b"\xff\xc0")
    data[header + 5 : header + 9] = size[1].to_bytes(2) + size[0].to_bytes(2)
    with pytest.raises(JpegError, match=r"too large|decoded"):
        decode_jpeg(bytes(data))


@given(st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=8))
def test_damage_is_refused_or_gives_a_picture_of_the_stated_size(
    changes: list[tuple[int, int]],
) -> None:
    data = bytearray(jpeg(PICTURE))
    for at, value in changes:
        data[at % len(data)] = value
    with contextlib.suppress(JpegError):
        width_px, height_px = jpeg_size(bytes(data))
        assert decode_jpeg(bytes(data)).shape == (height_px, width_px, 3)


@given(st.binary(max_size=300))
def test_other_bytes_are_no_picture(data: bytes) -> None:
    for attempt in (data, b"\xff\xd8" + data + b"\xff\xd9"):
        with pytest.raises(JpegError):
            decode_jpeg(attempt)


def test_png_is_no_jpeg() -> None:
    with pytest.raises(JpegError, match="it is not a JPEG"):
        decode_jpeg(cv2.imencode(".png", PICTURE)[1].tobytes())
