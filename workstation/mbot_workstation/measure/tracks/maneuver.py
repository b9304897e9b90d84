"""The eight maneuvers of the paper, full backward, neutral, full forward, and a slow one."""

from dataclasses import dataclass
from itertools import product

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError

NEUTRAL = "neutral"
LEVELS = {"forward": 1.0, NEUTRAL: 0.0, "backward": -1.0}
"""What a motor is told, as an action in [-1, 1]."""

MANEUVER_S = 10.0
REPETITIONS = 10
"""Both as in the paper."""


SLOW_PEAK = 0.4
"""Of full speed: where a wheel of any robot turns that turns at all."""

SLOW_LEG_S = 10.0
"""From standing to the peak and back, 17 of the board's 255 a second: a wheel of 100 ms lags by two
of them, up and down alike."""

BEAT_S = 0.1
"""In which a command that changes does so: as often as commands are sent."""


@dataclass(frozen=True, slots=True)
class Maneuver:
    """What both motors are told: one combination from beginning to end, or the slow ramps.

    Attributes:
        name: left motor, right motor, such as "forward-neutral"; or "slow".
        left, right: actions in [-1, 1]; 1 is full speed forward. Of the slow one its peak.
        is_slow: each wheel alone ramps up and down, forward and then backward: at which command
            it begins to turn and stops again is its dead band.

    """

    name: str
    left: float
    right: float
    is_slow: bool = False

    def told(self, elapsed_s: float) -> tuple[float, float]:
        """Left and right action at this moment; after its end 0, 0."""
        if not self.is_slow:
            return self.left, self.right
        beat = round(elapsed_s / BEAT_S)
        leg, within = divmod(beat * BEAT_S, SLOW_LEG_S)
        if not 0 <= leg < len(_SLOW_LEGS):
            return 0.0, 0.0
        size = SLOW_PEAK * (1 - abs(2 * within / SLOW_LEG_S - 1))
        left, right = _SLOW_LEGS[int(leg)]
        return round(left * size, 4), round(right * size, 4)

    def duration_s(self, held_s: float) -> float:
        """How long it takes, where the others are held for so long."""
        return SLOW_LEG_S * len(_SLOW_LEGS) if self.is_slow else held_s


_SLOW_LEGS = ((1, 0), (-1, 0), (0, 1), (0, -1))


MANEUVERS: tuple[Maneuver, ...] = tuple(
    Maneuver(f"{left}-{right}", LEVELS[left], LEVELS[right])
    for left, right in product(LEVELS, LEVELS)
    if (left, right) != (NEUTRAL, NEUTRAL)
)


SLOW = Maneuver("slow", SLOW_PEAK, SLOW_PEAK, is_slow=True)
"""Only where it is asked for: recordings without it go on working."""


def maneuver_named(name: str) -> Maneuver:
    """The maneuver of that name.

    Raises:
        ConfigurationError: there is none.

    """
    known = (*MANEUVERS, SLOW)
    for maneuver in known:
        if maneuver.name == name:
            return maneuver
    names = [maneuver.name for maneuver in known]
    raise ConfigurationError(
        f"there is no maneuver {name!r}, expected one of {', '.join(names)}"
        f"{did_you_mean(name, names)}"
    )
