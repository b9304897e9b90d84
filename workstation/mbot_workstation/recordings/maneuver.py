"""The paper's eight manoeuvres: full backward, neutral, full forward on both motors."""

from dataclasses import dataclass
from itertools import product

from mbot_protocol.errors import ConfigurationError

NEUTRAL = "neutral"
LEVELS = {"forward": 1.0, NEUTRAL: 0.0, "backward": -1.0}
"""What a motor is told, as an action in [-1, 1]."""

MANEUVER_S = 10.0
REPETITIONS = 10
"""Both as in the paper."""


@dataclass(frozen=True, slots=True)
class Maneuver:
    """One combination, held from beginning to end.

    Attributes:
        name: left motor, right motor, such as "forward-neutral".
        left, right: actions in [-1, 1]; 1 is full speed forward.

    """

    name: str
    left: float
    right: float


MANEUVERS: tuple[Maneuver, ...] = tuple(
    Maneuver(f"{left}-{right}", LEVELS[left], LEVELS[right])
    for left, right in product(LEVELS, LEVELS)
    if (left, right) != (NEUTRAL, NEUTRAL)
)


def maneuver_named(name: str) -> Maneuver:
    """The manoeuvre of that name.

    Raises:
        ConfigurationError: there is none.

    """
    for maneuver in MANEUVERS:
        if maneuver.name == name:
            return maneuver
    names = ", ".join(maneuver.name for maneuver in MANEUVERS)
    raise ConfigurationError(f"there is no manoeuvre {name!r}, expected one of {names}")
