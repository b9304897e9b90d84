"""When a camera's automatic exposure and white balance work, and when they are held.

Left to themselves they change the picture's light and colours in every turn towards a window.
"""

from typing import Literal

Light = Literal["held", "automatic", "unknown"]
"""Unknown: the source cannot be told, whatever it does."""

SETTLES_NS = 2_000_000_000
"""An opened camera's automatics have found the room's light after 60 frames; libcamera drops the
first ten or so itself and converges within a second (estimated)."""

STANDS_AFTER_NS = 1_000_000_000
"""A robot that does not turn its wheels for so long stands; a held decision does not count."""


class Automatics:
    """Decides when they are held.

    Args:
        setting: "settle" holds them while the robot drives and lets them work while it stands,
            "off" holds them once they have settled, "always" never holds them.

    """

    def __init__(self, setting: Literal["settle", "always", "off"]) -> None:
        self._setting = setting
        self._opened_ns = 0
        self._drove_ns: int | None = None

    def opened(self, now_ns: int) -> None:
        """The camera was opened: its automatics start over."""
        self._opened_ns = now_ns

    def drives(self, driving: bool, now_ns: int) -> None:
        """Say whether the wheels are being turned now; any thread."""
        if driving:
            self._drove_ns = now_ns

    def held(self, now_ns: int) -> bool:
        """Whether they should be held at this moment."""
        if self._setting == "always" or now_ns - self._opened_ns < SETTLES_NS:
            return False
        if self._setting == "off":
            return True
        drove_ns = self._drove_ns
        return drove_ns is not None and now_ns - drove_ns < STANDS_AFTER_NS
