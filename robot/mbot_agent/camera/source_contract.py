"""What a source of frames is, and a frame as it comes from there.

Each source is a context manager whose `read` blocks for the next frame and never longer than
READ_TIMEOUT_S, so that a dead camera can be closed and reopened.
"""

from collections.abc import Callable
from typing import Protocol, Self

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import UnreachableError

OPEN_TIMEOUT_S = 3.0
READ_TIMEOUT_S = 1.0


class CameraError(UnreachableError):
    """The camera cannot be opened, or delivers no frame."""


class JpegError(ValueError):
    """These bytes are not a usable JPEG; the message says why."""


class Shot:
    """A frame as it was delivered. Where it is still encoded, decoding waits until it is asked for:
    most of a stream's frames are replaced by the next one before anybody needs them.

    Attributes:
        shape: the picture's.
        captured_ns: monotonic.

    """

    def __init__(
        self, shape: tuple[int, ...], captured_ns: int, decode: Callable[[], Picture]
    ) -> None:
        """`decode` makes the picture, once; it may raise JpegError."""
        self.shape = shape
        self.captured_ns = captured_ns
        self._decode = decode
        self._picture: Picture | None = None

    @classmethod
    def decoded(cls, picture: Picture, captured_ns: int) -> "Shot":
        """One whose picture is there already: shape (height, width, 3), uint8, RGB."""
        shot = cls(picture.shape, captured_ns, lambda: picture)
        shot.picture()
        return shot

    @property
    def is_decoded(self) -> bool:
        """Whether its picture costs nothing any more."""
        return self._picture is not None

    def picture(self) -> Picture:
        """RGB, shape (height, width, 3). Any thread may ask.

        Raises:
            JpegError: it turns out to be damaged.

        """
        if self._picture is None:
            self._picture = self._decode()
        return self._picture


class FrameSource(Protocol):
    """One opened camera."""

    def __enter__(self) -> Self:
        """Open it."""
        ...

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Close it."""
        ...

    def read(self) -> Shot:
        """The next frame.

        Raises:
            CameraError: none came in READ_TIMEOUT_S, or the source has ended.

        """
        ...

    def hold_light(self, held: bool) -> bool:
        """Hold exposure and white balance as they are, or let them adjust themselves again.

        Returns:
            Whether the source can.

        """
        ...
