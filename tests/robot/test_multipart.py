"""Streams as cameras send them, torn into pieces anywhere."""

import itertools
import re
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.camera.multipart import (
    LARGEST_HEAD_BYTES,
    LARGEST_PART_BYTES,
    MultipartError,
    MultipartParser,
)

BOUNDARY = "frame"
PIECE_BYTES = 64 << 10
DELIMITER_LINE = re.compile(rb"\n--+frame")

bodies = st.lists(
    st.binary(max_size=300).filter(lambda data: not DELIMITER_LINE.search(b"\n" + data)),
    max_size=6,
)
cuts = st.lists(st.integers(0, 3000), max_size=20)


def stream(
    parts: list[bytes], *, counted: bool = True, newline: str = "\r\n", dashes: str = "--"
) -> bytes:
    """Parts as a camera sends them; the delimiter of one more part follows."""
    data = b""
    for part in parts:
        head = f"{dashes}{BOUNDARY}{newline}Content-Type: image/jpeg{newline}"
        head += f"Content-Length: {len(part)}{newline}" if counted else ""
        data += (head + newline).encode() + part + newline.encode()
    return data + f"{dashes}{BOUNDARY}{newline}".encode()


def parsed(data: bytes, cuts: Sequence[int] = (), boundary: str = BOUNDARY) -> list[bytes]:
    """The parts that come out if the bytes come in pieces."""
    parser = MultipartParser(boundary)
    edges = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
    return [
        part.data
        for begin, end in itertools.pairwise(edges)
        for part in parser.feed(data[begin:end], end)
    ]


@given(
    bodies, cuts, st.booleans(), st.sampled_from(["\r\n", "\n"]), st.sampled_from(["--", "----"])
)
def test_parts_come_out_whole_however_they_are_torn(
    parts: list[bytes], cuts: list[int], counted: bool, newline: str, dashes: str
) -> None:
    if not counted:  # a carriage return before the newline may be either's
        parts = [part.rstrip(b"\r") for part in parts]
    data = stream(parts, counted=counted, newline=newline, dashes=dashes)
    assert parsed(data, cuts) == parts


@given(bodies, st.sampled_from(["--frame", "----frame"]))
def test_dashes_that_are_counted_in_do_not_matter(parts: list[bytes], boundary: str) -> None:
    assert parsed(stream(parts), boundary=boundary) == parts
    assert parsed(stream(parts, dashes="----"), boundary=boundary) == parts


def test_a_part_needs_no_headers_and_no_newline_before_the_next() -> None:
    assert parsed(b"--frame\r\n\r\nabc\r\n--frame\r\n") == [b"abc"]
    head = b"--frame\r\nContent-Length: 3\r\n\r\n"
    assert parsed(head + b"abc" + head + b"def") == [b"abc", b"def"]


def test_headers_may_stand_on_the_boundarys_line() -> None:
    for head in (b"Content-Length: 3\r\n", b"content-type: image/jpeg\r\nContent-Length: 3\r\n"):
        data = b"--frame" + head + b"\r\nabc\r\n--frame" + head + b"\r\ndef\r\n"
        assert parsed(data, cuts=range(len(data))) == [b"abc", b"def"]


@given(st.binary(max_size=100), st.integers(0, 200))
def test_a_wrong_length_spoils_a_part_or_two_and_no_more(junk: bytes, length: int) -> None:
    data = f"--frame\r\nContent-Length: {length}\r\n\r\n".encode() + junk + b"\r\n"
    good = [b"%d" % number * 50 for number in range(10)]
    assert parsed(data + stream(good))[-5:] == good[-5:]


def test_a_part_began_with_its_first_byte() -> None:
    parser = MultipartParser(BOUNDARY)
    assert parser.feed(b"--frame\r\n", 1) == []  # sent ahead, before the picture is there
    assert parser.feed(b"Content-", 2) == []
    assert parser.feed(b"Length: 4\r\n\r\nab", 3) == []
    (part,) = parser.feed(b"cd\r\n--frame\r\n", 4)
    assert (part.data, part.began_ns) == (b"abcd", 2)
    (part,) = parser.feed(b"\r\nefgh\r\n--frame\r\n", 5)
    assert (part.data, part.began_ns) == (b"efgh", 5)


def test_an_announced_end_is_an_end() -> None:
    parser = MultipartParser(BOUNDARY)
    with pytest.raises(MultipartError, match="ended"):
        parser.feed(stream([b"abc"]).removesuffix(b"\r\n") + b"--\r\n", 1)


@pytest.mark.parametrize("boundary", ["", "--", "x" * 201])
def test_an_unusable_boundary_is_refused(boundary: str) -> None:
    with pytest.raises(MultipartError, match="boundary"):
        MultipartParser(boundary)


def test_a_giant_part_is_refused_by_its_length() -> None:
    parser = MultipartParser(BOUNDARY)
    with pytest.raises(MultipartError, match="expected at most"):
        parser.feed(b"--frame\r\nContent-Length: %d\r\n\r\n" % (LARGEST_PART_BYTES + 1), 1)


@pytest.mark.parametrize(
    ("begin", "limit"),
    [
        (b"", LARGEST_PART_BYTES),
        (b"--frame\r\n\r\n", LARGEST_PART_BYTES),
        (b"--frame\r\nA: ", LARGEST_HEAD_BYTES),
    ],
    ids=["no delimiter", "no end", "endless header"],
)
def test_what_never_ends_is_cut_off(begin: bytes, limit: int) -> None:
    parser = MultipartParser(BOUNDARY)
    parser.feed(begin, 1)
    for _ in range(limit // PIECE_BYTES):
        parser.feed(bytes(PIECE_BYTES), 2)
    with pytest.raises(MultipartError, match="without a picture's end"):
        parser.feed(bytes(PIECE_BYTES), 2)


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_no_bytes_break_it(pieces: list[bytes]) -> None:
    parser = MultipartParser(BOUNDARY)
    try:
        for piece in pieces:
            parser.feed(b"\n--frame".join(piece.split(b"\0")), 1)
    except MultipartError:
        pass
