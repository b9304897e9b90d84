"""The seam between the loop and the hardware: what it sees of a camera and of a board.

The rooms `camera` and `board` fill these in; the tests put fakes in their place.
"""

from dataclasses import dataclass
from typing import Protocol

from mbot_agent.faults import Fault
from mbot_protocol.drive.picture import Picture
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import WheelCommand


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame to decide on.

    Attributes:
        picture: shape (height, width, 3), uint8, RGB.
        captured_ns: monotonic.

    """

    picture: Picture
    captured_ns: int


@dataclass(frozen=True, slots=True)
class Delivery:
    """When a command was written and acknowledged, monotonic."""

    written_ns: int
    acknowledged_ns: int


class Camera(Protocol):
    """Something that delivers frames."""

    @property
    def fault(self) -> Fault | None:
        """Why the newest picture must not be driven on, if so."""
        ...

    @property
    def interval_ns(self) -> int:
        """Time between two frames, as a running mean; 0 before there are two."""
        ...

    def latest(self) -> Frame | None:
        """The newest good frame, however old."""
        ...

    def is_fresh(self) -> bool:
        """Whether the newest good frame is recent enough to drive on; any thread may ask."""
        ...

    @property
    def light(self) -> str:
        """What its automatic exposure and white balance do: automatic, held or unknown."""
        ...

    def drives(self, driving: bool) -> None:
        """Learn whether the wheels are being turned now."""
        ...

    def forgive(self) -> None:
        """Believe a picture that stood still once more: a person wants to drive again."""
        ...


class Board(Protocol):
    """Something that turns two wheels."""

    @property
    def fault(self) -> Fault | None:
        """Why the wheels cannot be driven now, if they cannot."""
        ...

    @property
    def version(self) -> str:
        """The firmware's name of itself; empty while not connected."""
        ...

    @property
    def has_deadman(self) -> bool:
        """Whether the firmware stops by itself when commands cease."""
        ...

    @property
    def resets(self) -> int:
        """How often the board has reset or latched by itself since the daemon's start."""
        ...

    @property
    def senses(self) -> Senses | None:
        """What the board feels; None: it tells nothing of it."""
        ...

    @property
    def edges(self) -> int:
        """How often the board has begun to hold back for want of floor since the daemon's start."""
        ...

    def arm(self) -> None:
        """A person wants to drive: a board that has latched may be told so, once."""
        ...

    def disarm(self) -> None:
        """Nobody wants to drive any more: what `arm` left to be said must not be said."""
        ...

    def drive(self, command: WheelCommand) -> int:
        """Make this the command in force. Returns a ticket for `delivery`."""
        ...

    def delivery(self, ticket: int, timeout_s: float) -> Delivery | None:
        """Wait for a command's acknowledgement; None if it does not come in time."""
        ...

    def stop(self) -> None:
        """End any command; the motors stop at once if they were driven."""
        ...

    def stands(self, timeout_s: float) -> bool:
        """Whether the board acknowledges, from now on and within the time, that its motors are off;
        false at once if it is lost.
        """
        ...
