"""What a hand on a gamepad or a keyboard wants now."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Wish:
    """As of now.

    Attributes:
        wheels: left and right in [-1, 1] while the hand holds; None while it does not.
        stop: STOP was asked for since the last wish.
        run: the policy was asked to drive since the last wish.
        end: nothing more will come: asked to end, or the device is gone.

    """

    wheels: tuple[float, float] | None = None
    stop: bool = False
    run: bool = False
    end: bool = False


class HandInput(Protocol):
    """A device that a hand holds."""

    def read(self, wait_s: float) -> Wish:
        """Wait so long for something to happen, and say what is wanted then."""
        ...


def mixed(ahead: float, turn: float) -> tuple[float, float]:
    """Wheels in [-1, 1] from how much ahead and how much to the right, each in [-1, 1]."""
    left, right = ahead + turn, ahead - turn
    most = max(1.0, abs(left), abs(right))
    return left / most, right / most
