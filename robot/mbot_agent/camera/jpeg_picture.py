"""A JPEG from the network made a picture: whole, and of a size and a cost known before decoding.

libjpeg judges it, by its warnings too. It gets the headers that were read here and none besides, so
it can't find another size in them. What cameras add (comments longer than they say, bytes between
segments or behind the end) is skipped as by libjpeg: up to the next marker.
"""

import math
import re
from dataclasses import dataclass

from simplejpeg import decode_jpeg  # pyright: ignore[reportMissingTypeStubs]

from mbot_agent.camera.source_contract import JpegError
from mbot_protocol.drive.picture import Picture

LARGEST_SIDE_PX = 8192
"""As in the configuration (camera.width_px)."""

LARGEST_PIXELS = 16 << 20
"""48 MB decoded. A few bytes can claim to be 65535 x 65535. Pixels count once a scan, for each scan
of a progressive JPEG goes over all of them: the slowest of many took 0.1 s (measured, PC)."""

MOST_SCANS = 20
"""An encoder makes ten of a progressive JPEG in colour (libjpeg's own script); cameras send one."""

MOST_SEGMENTS = 64
"""Before the picture: 4 quantisation tables, 8 of Huffman's, 16 kinds of application data, and some
of those again where one is too short for all of it."""

MOST_EXTRANEOUS_BYTES = 16
"""Too many before a marker, of a picture that is whole: Logitech C270, C910 and others send up to 9
(public reports). More are the end of another picture."""

_START = b"\xff\xd8"
_MARKER = re.compile(rb"\xff([\x01-\xfe])")
_SCAN_OR_END = re.compile(rb"\xff([\xd9\xda])")
_RESTART = re.compile(rb"\xff([\xd0-\xd7])")
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of kinds of JPEG; the three are tables."""
_KNOWN_FRAMES = {0xC0, 0xC1, 0xC2}
"""Baseline, extended and progressive, by Huffman's code."""
_STANDALONE = {0x01, *range(0xD0, 0xDA)}
_RESTART_INTERVAL, _SCAN, _END = 0xDD, 0xDA, 0xD9
_TABLES = {0xC4, 0xDB, _RESTART_INTERVAL, 0xEE}
"""What the decoder needs of the rest: Huffman's and quantisation tables, the interval of restarts,
Adobe's word on colours."""
_KEPT = _KNOWN_FRAMES | _TABLES | {_SCAN}

_EXTRANEOUS = re.compile(r"Corrupt JPEG data: (\d+) extraneous bytes before marker 0xd([0-79])")
_CUT_OFF = re.compile("premature end", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Jpeg:
    """A JPEG whose headers have been read, and its data as the decoder gets them.

    Attributes:
        restarts: markers between its pieces; None where there are several scans.

    """

    width_px: int
    height_px: int
    restarts: int | None
    data: bytes

    def picture(self) -> Picture:
        """The picture, RGB, shape (height, width, 3).

        Raises:
            JpegError: it is cut off or damaged.

        """
        try:
            picture = decode_jpeg(self.data, "RGB")
        except ValueError as error:
            if not self._is_whole_but_for(str(error)):
                raise JpegError(_reason(str(error))) from None
            picture = decode_jpeg(self.data, "RGB", strict=False)
        if picture.shape != (self.height_px, self.width_px, 3):
            raise JpegError("it cannot be decoded")
        return picture

    def _is_whole_but_for(self, warning: str) -> bool:
        """Whether libjpeg's first warning is of a few bytes too many and hides no worse one:
        nothing comes behind the end, and no restart is missing where the picture goes on.
        """
        found = _EXTRANEOUS.match(warning)
        if found is None or int(found[1]) > MOST_EXTRANEOUS_BYTES:
            return False
        if found[2] == "9":
            return True
        numbers = [marker[0] & 7 for marker in _RESTART.findall(self.data)]
        return self.restarts is not None and numbers == [n % 8 for n in range(self.restarts)]


def read_jpeg(data: bytes) -> Jpeg:
    """The JPEG that begins the data; bytes behind its end are left out.

    Raises:
        JpegError: it is not a JPEG, its end is missing, or it is too large to be decoded here.

    """
    if not data.startswith(_START):
        raise JpegError("it is not a JPEG")
    frame, interval, at, kept = b"", 0, len(_START), [_START]
    for _ in range(MOST_SEGMENTS):
        marker, segment, at = _segment(data, at)
        if marker in _FRAMES:
            if frame or marker not in _KNOWN_FRAMES:
                raise JpegError("its headers are damaged")
            frame = segment
        elif marker == _RESTART_INTERVAL:
            interval = int.from_bytes(segment[2:4])
        if marker in _KEPT:
            kept.append(bytes((0xFF, marker)) + segment)
        if marker == _SCAN:
            break
    else:
        raise JpegError("its headers are damaged")
    width_px, height_px, mcus = _frame(frame)
    end, scans = _end(data, at)
    if (
        max(width_px, height_px) > LARGEST_SIDE_PX
        or width_px * height_px * scans > LARGEST_PIXELS
        or scans > MOST_SCANS
    ):
        scanned = f" in {scans} scans" if scans > 1 else ""
        raise JpegError(f"it has {width_px} x {height_px} pixels{scanned}, which is too large")
    restarts = None if scans > 1 else math.ceil(mcus / interval) - 1 if interval else 0
    return Jpeg(width_px, height_px, restarts, b"".join(kept) + data[at:end])


def _segment(data: bytes, at: int) -> tuple[int, bytes, int]:
    """The next marker, its segment from the length on, and where that ends."""
    found = _MARKER.search(data, at)
    if found is not None and (marker := found[1][0]) not in _STANDALONE:
        end = found.end() + int.from_bytes(data[found.end() : found.end() + 2])
        if found.end() + 2 <= end <= len(data):
            return marker, data[found.end() : end], end
    raise JpegError("its headers are damaged")


def _frame(segment: bytes) -> tuple[int, int, int]:
    """Width and height in pixels, and of how many units (MCU) a scan of all of it consists."""
    components = segment[7] if len(segment) > 7 else 0
    factors = [divmod(factor, 16) for factor in segment[9 : 9 + 3 * components : 3]]
    height_px, width_px = int.from_bytes(segment[3:5]), int.from_bytes(segment[5:7])
    if (
        segment[2:3] != b"\x08"
        or components not in (1, 3)
        or len(factors) != components
        or not all(across and down for across, down in factors)
        or not (width_px and height_px)
    ):
        raise JpegError("its headers are damaged")
    # Of one component alone a unit is a block, whatever its factors are.
    across, down = (1, 1) if components == 1 else map(max, zip(*factors, strict=True))
    return width_px, height_px, math.ceil(width_px / 8 / across) * math.ceil(height_px / 8 / down)


def _end(data: bytes, at: int) -> tuple[int, int]:
    """Where the picture whose first scan begins here ends, and how many scans it has; of more than
    are allowed the rest is not counted.

    Compressed data have no such markers in them. A table between two scans might; it is not whole
    then, and the decoder says so.
    """
    scans = 1
    for found in _SCAN_OR_END.finditer(data, at):
        if found[1][0] == _END:
            return found.end(), scans
        scans += 1
        if scans > MOST_SCANS:
            return found.end(), scans
    raise JpegError("it is cut off")


def _reason(warning: str) -> str:
    return "it is cut off" if _CUT_OFF.search(warning) else f"it is damaged ({warning})"
