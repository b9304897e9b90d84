"""JPEGs from the network: whole ones are decoded, whatever a camera adds; all else is refused."""

import contextlib
import re
import time

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.camera import jpeg_picture
from mbot_agent.camera.jpeg_picture import MOST_SCANS, MOST_SEGMENTS, read_jpeg
from mbot_agent.camera.source_contract import JpegError
from mbot_protocol.drive.picture import Picture

PICTURE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)
PROGRESSIVE = (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
RESTARTS = (cv2.IMWRITE_JPEG_RST_INTERVAL, 1)


def jpeg(picture: np.ndarray, *flags: int) -> bytes:
    """Of a picture in OpenCV's order of colours."""
    return cv2.imencode(".jpg", picture, flags)[1].tobytes()


def decode(data: bytes) -> Picture:
    return read_jpeg(data).picture()


GOOD = jpeg(PICTURE)
OLDER = jpeg(PICTURE[::-1])
FRAME, SCAN = GOOD.index(b"\xff\xc0"), GOOD.index(b"\xff\xda")


@given(
    st.integers(1, 300),
    st.integers(1, 300),
    st.sampled_from([(), PROGRESSIVE, RESTARTS, (cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x411111)]),
)
def test_the_size_is_known_before_decoding(
    width_px: int, height_px: int, flags: tuple[int, ...]
) -> None:
    data = jpeg(np.full((height_px, width_px, 3), 90, np.uint8), *flags)
    found = read_jpeg(data)
    assert (found.width_px, found.height_px) == (width_px, height_px)
    assert found.picture().shape == (height_px, width_px, 3)


def test_colours_are_rgb_and_grey_becomes_three() -> None:
    blue, green, red = 10, 20, 200
    picture = decode(jpeg(np.full((48, 64, 3), (blue, green, red), np.uint8)))
    assert np.abs(picture.reshape(-1, 3).mean(0) - (red, green, blue)).max() < 3
    assert decode(jpeg(PICTURE[..., 0])).shape == (48, 64, 3)


@pytest.mark.parametrize(
    "data",
    [
        GOOD + b"\0\0\0\r\n",
        GOOD + b"dhav\x59\x19\x01\x00",
        GOOD + OLDER[700:796],
        GOOD + OLDER[-64:],
        GOOD + b"\xaa" * 300,
        GOOD[:2] + b"\xff\xfe\x0f\xfe" + bytes(4700) + GOOD[2:],
        GOOD[:FRAME] + b"\xff" + GOOD[FRAME:],
        GOOD[:SCAN] + b"\xff" + GOOD[SCAN:],
        GOOD[:FRAME] + b"\0\0\0" + GOOD[FRAME:],
        GOOD[:2] + b"\xff\xe0\0\x10JFIF\0\x07\x07" + bytes(7) + GOOD[2:],
        GOOD[:-2] + b"\x55" * 8 + GOOD[-2:],
    ],
    ids=[
        "padding",
        "bytes behind the end",
        "bytes of an older picture behind the end",
        "an older picture's end behind the end",
        "much behind the end",
        "a comment that is longer than it says",
        "a fill byte before the frame's header",
        "a fill byte before the scan",
        "bytes between segments",
        "a version of JFIF that nobody knows",
        "bytes before the end",
    ],
)
def test_what_cameras_add_is_no_damage(data: bytes) -> None:
    assert np.array_equal(decode(data), decode(GOOD))


def restarted(number: int, put: bytes, *, cut: int = 0) -> bytes:
    """A picture with this before one of its restarts, where so many bytes are cut off."""
    data = jpeg(PICTURE, *RESTARTS)
    at = [found.start() for found in re.finditer(rb"\xff[\xd0-\xd7]", data)][number]
    return data[: at - cut] + put + data[at:]


def test_a_webcams_extra_bytes_before_restarts_are_no_damage() -> None:
    assert np.array_equal(decode(restarted(1, b"\x55" * 9)), decode(restarted(1, b"")))


@pytest.mark.parametrize(
    "data",
    [
        restarted(1, b"\x55" * 40),
        restarted(1, b"", cut=40),
        # Behind a harmless one libjpeg's warning of a worse one is lost: the restarts are counted.
        restarted(1, b"\x55" * 9).replace(b"\xff\xd3", b""),
        restarted(1, b"\x55" * 9).partition(b"\xff\xd5")[0] + b"\xff\xd9",
    ],
    ids=["bytes of another picture", "bytes lost", "restart lost", "cut off"],
)
def test_what_is_damaged_between_restarts_is_refused(data: bytes) -> None:
    with pytest.raises(JpegError):
        decode(data)


@given(st.floats(0, 1, exclude_max=True), st.sampled_from([b"", b"\xff\xd9"]))
def test_what_is_cut_off_is_refused(share: float, end: bytes) -> None:
    data = GOOD[: int((len(GOOD) - 2) * share)]
    with pytest.raises(JpegError):
        decode(data + end)


@pytest.mark.parametrize("kept", [1 / 2, 3 / 4])
@pytest.mark.parametrize("tail", [300, 700])
def test_half_a_picture_that_ends_in_an_older_ones_tail_is_refused(kept: float, tail: int) -> None:
    """As from a camera's buffer that was read while it was written."""
    with pytest.raises(JpegError):
        decode(GOOD[: int(len(GOOD) * kept)] + OLDER[-tail:])


def test_a_cut_off_picture_is_called_so() -> None:
    for data in (GOOD[:-40], GOOD[:-40] + b"\xff\xd9", GOOD[: len(GOOD) // 2] + OLDER[-300:]):
        with pytest.raises(JpegError, match="it is cut off"):
            decode(data)


def sized(width_px: int, height_px: int, data: bytes = GOOD) -> bytes:
    """A picture that says that it has another size."""
    header = re.search(rb"\xff[\xc0\xc2]", data)
    assert header is not None
    at = header.start() + 5
    return data[:at] + height_px.to_bytes(2) + width_px.to_bytes(2) + data[at + 4 :]


@pytest.mark.parametrize("size", [(65535, 65535), (8193, 16), (16, 8193), (8192, 8192), (0, 48)])
def test_a_false_size_is_refused_before_decoding(size: tuple[int, int]) -> None:
    with pytest.raises(JpegError, match=r"too large|headers are damaged"):
        read_jpeg(sized(*size))


LARGE = sized(20_000, 20_000)
HIDDEN = LARGE[FRAME:SCAN]
"""What libjpeg would find: a frame of 1.2 GB."""


@pytest.mark.parametrize("marker", [b"\x01", b"\xd0", b"\xd7", b"\xd8"])
def test_a_frame_is_not_hidden_behind_a_marker_that_has_no_length(marker: bytes) -> None:
    """Who reads a length there skips what libjpeg reads."""
    length = (len(HIDDEN) + 2).to_bytes(2)
    with pytest.raises(JpegError, match="headers are damaged"):
        read_jpeg(GOOD[:2] + b"\xff" + marker + length + HIDDEN + GOOD[2:])


@pytest.mark.parametrize(
    "data",
    [
        GOOD[:SCAN] + HIDDEN + GOOD[SCAN:],
        GOOD[:FRAME] + HIDDEN + GOOD[FRAME:],
        GOOD[:FRAME] + b"\xff\xc9" + GOOD[FRAME + 2 :],
        GOOD[:2] + b"\xff\xfe\0\x02" * MOST_SEGMENTS + GOOD[2:],
        GOOD[: FRAME + 9] + b"\x04" + GOOD[FRAME + 10 :],
        GOOD[: FRAME + 11] + b"\0" + GOOD[FRAME + 12 :],
    ],
    ids=[
        "a frame before the scan",
        "a frame before the frame",
        "another code",
        "very many segments",
        "four colours",
        "a component of no width",
    ],
)
def test_other_headers_than_cameras_send_are_refused(data: bytes) -> None:
    with pytest.raises(JpegError, match="headers are damaged"):
        read_jpeg(data)


def test_a_second_frame_behind_the_first_is_refused() -> None:
    with pytest.raises(JpegError):
        decode(GOOD[:-2] + HIDDEN + GOOD[SCAN:])


def test_the_decoder_gets_no_size_but_the_one_that_was_judged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A comment with another picture's headers in it, which is shorter than it says."""
    given: list[bytes] = []
    monkeypatch.setattr(jpeg_picture, "decode_jpeg", lambda data, _: given.append(data) or PICTURE)
    read_jpeg(GOOD[:2] + b"\xff\xfe\x10\0" + HIDDEN.ljust(0xFFE, b"\0") + GOOD[2:]).picture()
    assert len(re.findall(rb"\xff[\xc0-\xc2]\0\x11", given[0])) == 1
    assert HIDDEN not in given[0]


def scans(count: int) -> bytes:
    """A progressive picture with its last scan again and again."""
    data = jpeg(PICTURE, *PROGRESSIVE)
    last = data.rindex(b"\xff\xda")
    again = count - data.count(b"\xff\xda")
    return data[:-2] + data[last:-2] * again + b"\xff\xd9"


def test_more_scans_than_any_encoder_makes_are_refused_before_decoding() -> None:
    assert read_jpeg(scans(MOST_SCANS)).width_px == 64
    with pytest.raises(JpegError, match="scans, which is too large"):
        read_jpeg(scans(MOST_SCANS + 1))
    with pytest.raises(JpegError, match="scans, which is too large"):
        read_jpeg(scans(10_000))


def test_pixels_count_once_a_scan() -> None:
    data = jpeg(PICTURE, *PROGRESSIVE)
    assert data.count(b"\xff\xda") == 10
    assert read_jpeg(sized(1640, 1000, data)).width_px == 1640
    with pytest.raises(JpegError, match="1700 x 1000 pixels in 10 scans, which is too large"):
        read_jpeg(sized(1700, 1000, data))


@pytest.mark.parametrize(
    "data",
    [
        jpeg(np.zeros((4096, 4096, 3), np.uint8)),
        jpeg(np.zeros((1260, 1260, 3), np.uint8), *PROGRESSIVE),
        scans(MOST_SCANS),
        GOOD[:2] + bytes(4 << 20),
        GOOD[:2] + b"\xff\0" * (2 << 20),
        GOOD[:2] + b"\xff\xfe\0\x02" * (1 << 20),
        GOOD[:-2] + b"\xff\xda" * (2 << 20),
    ],
    ids=["large", "progressive", "scans", "zeros", "no markers", "comments", "empty scans"],
)
def test_the_most_expensive_that_is_decoded_takes_less_than_a_beat(data: bytes) -> None:
    """0.1 s at most on a PC; before there were bounds, 50 minutes."""
    began_s = time.process_time()
    with contextlib.suppress(JpegError):
        decode(data)
    assert time.process_time() - began_s < 0.4


@given(st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=8))
def test_damage_is_refused_or_gives_a_picture_of_the_stated_size(
    changes: list[tuple[int, int]],
) -> None:
    data = bytearray(GOOD)
    for at, value in changes:
        data[at % len(data)] = value
    with contextlib.suppress(JpegError):
        found = read_jpeg(bytes(data))
        assert found.picture().shape == (found.height_px, found.width_px, 3)


@given(st.binary(max_size=300))
def test_other_bytes_are_no_picture(data: bytes) -> None:
    for attempt in (data, b"\xff\xd8" + data + b"\xff\xd9"):
        with pytest.raises(JpegError):
            decode(attempt)


def test_png_is_no_jpeg() -> None:
    with pytest.raises(JpegError, match="it is not a JPEG"):
        decode(cv2.imencode(".png", PICTURE)[1].tobytes())
