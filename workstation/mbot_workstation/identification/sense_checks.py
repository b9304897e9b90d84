"""What no robot and no tracker does: turning against commands, mirrored places, absurd speeds."""

from collections.abc import Sequence

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.identification.steady_motion import SteadyPiece

SLOWEST_M_S, FASTEST_M_S = 0.02, 3.0
"""Of such a robot's wheel; beyond, the unit of length or time is wrong."""

TURNS_AGAINST = (
    "the robot turns the other way than it was told, in all manoeuvres that turn: left and right "
    "are swapped (the motors' plugs, or the columns left and right of commands.csv), both motors "
    "run backwards, or the tracker's frame is mirrored (handedness in track.toml)"
)


def check_senses(left: float, right: float) -> None:
    """Refuse wheels that roll against their commands.

    Args:
        left, right: by how much a wheel's forward command turns the robot, as it should [rad/s].

    Raises:
        ConfigurationError: one of them or both are negative.

    """
    if left > 0 and right > 0:
        return
    if left < 0 and right < 0:
        raise ConfigurationError(TURNS_AGAINST)
    side = "left" if left < 0 else "right"
    raise ConfigurationError(
        f"the {side} motor runs against its commands: told to drive straight, the robot turns; "
        "swap its two wires, or set `reversed` in the robot's configuration, and record again"
    )


def check_mirror(pieces: Sequence[SteadyPiece]) -> None:
    """Refuse a tracker whose place turns the other way than its attitude.

    Raises:
        ConfigurationError: it does so in most turns.

    """
    turning = [piece for piece in pieces if abs(piece.turn_rate) > 1]
    if turning and sum(piece.mirrored for piece in turning) > len(turning) / 2:
        raise ConfigurationError(
            "the tracked place turns the other way than the tracked attitude: one of the two is "
            "mirrored (an axis with the wrong sign, or the order of columns in track.toml)"
        )


def check_speed(speed_m_s: float) -> None:
    """Refuse a wheel that no mBot has.

    Raises:
        ConfigurationError: it rolls too slowly or too fast.

    """
    if not SLOWEST_M_S < speed_m_s < FASTEST_M_S:
        raise ConfigurationError(
            f"a wheel rolls at {speed_m_s:.3g} m/s at full command, expected about 0.4: are the "
            "tracks in metres and seconds? (position_unit and time_unit in track.toml)"
        )
