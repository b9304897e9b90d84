"""Parts of a `multipart/x-mixed-replace` stream, the way cameras send pictures over HTTP.

An incremental parser: bytes go in as they come, whole parts come out. It takes what cameras make of
the standard: lengths missing or wrong, boundaries quoted with or without their dashes, no headers,
no newline before them.
"""

import re
from dataclasses import dataclass

LARGEST_PART_BYTES = 4 << 20
"""A JPEG of 8192 x 8192 that shows something may be larger; no camera for 30 frames/s sends one."""

LARGEST_HEAD_BYTES = 4096

_LONGEST_BOUNDARY = 200
_LONGEST_DELIMITER = _LONGEST_BOUNDARY + 100
_HEAD_END = re.compile(rb"\n\r?\n")
_LENGTH = re.compile(rb"(?:^|\n)content-length:[ \t]*(\d{1,9})[ \t]*\r?\n", re.IGNORECASE)


class MultipartError(ValueError):
    """The stream has ended or is none; the message completes "the camera ..."."""


@dataclass(frozen=True, slots=True)
class Part:
    """One part.

    Attributes:
        data: its body.
        began_ns: when its first byte was there; so what it shows is no younger than that.

    """

    data: bytes
    began_ns: int


class MultipartParser:
    """Takes a stream apart. After a MultipartError it is of no use any more."""

    def __init__(self, boundary: str) -> None:
        """`boundary` as the stream's Content-Type names it.

        Raises:
            MultipartError: it is empty or too long.

        """
        name = boundary.lstrip("-")  # some count the two dashes in, some do not
        if not 0 < len(name) <= _LONGEST_BOUNDARY:
            raise MultipartError(f"names an unusable boundary, {boundary[:80]!r}")
        quoted = re.escape(name.encode(errors="replace"))
        self._delimiter = re.compile(
            rb"\n--+" + quoted + rb"(--)?(?:[ \t\r]*(?=\n)|(?=(?i:content-)))"
        )
        # A delimiter is a line; the first may be the stream's very first.
        self._buffer = bytearray(b"\n")
        self._searched_bytes = 0
        self._in_head = self._in_body = False
        self._length: int | None = None
        self._began_ns: int | None = None

    def feed(self, data: bytes, received_ns: int) -> list[Part]:
        """The parts that these bytes complete.

        Raises:
            MultipartError: the stream says that it ends, or something is too large.

        """
        self._buffer += data
        parts: list[Part] = []
        while self._step(parts, received_ns):
            pass
        limit = LARGEST_HEAD_BYTES if self._in_head else LARGEST_PART_BYTES + _LONGEST_DELIMITER
        if len(self._buffer) > limit:
            raise MultipartError(f"sends more than {limit} bytes without a picture's end")
        return parts

    def _step(self, parts: list[Part], received_ns: int) -> bool:
        """Get one piece further; false if more bytes are needed for that."""
        if self._in_head:
            return self._read_head(received_ns)
        if self._in_body and self._length is not None:
            return self._read_counted_body(self._length, parts)
        return self._read_up_to_delimiter(parts)

    def _read_head(self, received_ns: int) -> bool:
        """Headers, from what follows the delimiter, mostly a newline, to the empty line."""
        if self._began_ns is None and len(self._buffer) > 1:
            self._began_ns = received_ns
        end = _HEAD_END.search(self._buffer, 0, LARGEST_HEAD_BYTES)
        if end is None:
            return False
        length = _LENGTH.search(self._buffer, 0, end.end())
        self._length = int(length[1]) if length is not None else None
        if self._length is not None and self._length > LARGEST_PART_BYTES:
            raise MultipartError(
                f"sends a picture of {self._length} bytes, expected at most {LARGEST_PART_BYTES}"
            )
        del self._buffer[: end.end()]
        self._in_head, self._in_body = False, True
        return True

    def _read_counted_body(self, length: int, parts: list[Part]) -> bool:
        if len(self._buffer) < length:
            return False
        self._finish(bytes(self._buffer[:length]), parts)
        # The newline is the delimiter's first byte, which not everybody sends.
        self._buffer[:length] = b"\n"
        return True

    def _read_up_to_delimiter(self, parts: list[Part]) -> bool:
        """The rest of a body of unknown length, or what stands between two parts."""
        delimiter = self._delimiter.search(self._buffer, self._searched_bytes)
        if delimiter is None:
            self._searched_bytes = max(0, len(self._buffer) - _LONGEST_DELIMITER)
            return False
        if self._in_body:
            self._finish(bytes(self._buffer[: delimiter.start()]).removesuffix(b"\r"), parts)
        if delimiter[1]:
            raise MultipartError("has ended its stream")
        del self._buffer[: delimiter.end()]
        self._searched_bytes = 0
        self._in_head, self._began_ns = True, None
        return True

    def _finish(self, data: bytes, parts: list[Part]) -> None:
        parts.append(Part(data, self._began_ns or 0))
        self._in_body, self._length = False, None
