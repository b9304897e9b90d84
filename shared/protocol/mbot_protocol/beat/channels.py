"""What stands in a recording of a drive: its topics, and which robot it was."""

import msgspec

from mbot_protocol.drive.actions import MotorMap, WheelMaps

DECISION_TOPIC, DRIVE_TOPIC = "decision", "drive"
OBSERVATION_TOPIC, CAMERA_TOPIC, LOG_TOPIC = "observation", "camera", "log"
POSE_TOPIC = "pose"

ROBOT_METADATA = "mbot.robot"
"""The metadata record of a recording that says which robot it was: `RobotFacts` as strings."""


class RobotFacts(msgspec.Struct, frozen=True):
    """Whose recording this is, and what turns an action of its policy into the board's speeds.

    Attributes:
        robot_id, session_id: as in Decision.
        software_version: of mbot-agent.
        processor: what has computed; another one may differ in the last digits.
        decision_rate_hz: beats a second.
        left_reversed, left_trim, left_dead_band: `drive.actions.MotorMap`, left wheel.
        right_reversed, right_trim, right_dead_band: the right one.

    """

    robot_id: str
    session_id: int
    software_version: str
    processor: str
    decision_rate_hz: float
    left_reversed: bool
    left_trim: float
    left_dead_band: int
    right_reversed: bool
    right_trim: float
    right_dead_band: int

    def to_strings(self) -> dict[str, str]:
        """As MCAP keeps metadata."""
        return {name: str(getattr(self, name)) for name in self.__struct_fields__}

    @property
    def wheels(self) -> WheelMaps:
        """How both wheels' steps became the board's speeds."""
        return WheelMaps(
            MotorMap(self.left_reversed, self.left_trim, self.left_dead_band),
            MotorMap(self.right_reversed, self.right_trim, self.right_dead_band),
        )

    @classmethod
    def from_strings(cls, strings: dict[str, str]) -> "RobotFacts":
        """Read what `to_strings` wrote.

        Raises:
            ValueError: a value is missing or of another kind; it says which.

        """
        return msgspec.convert(
            {
                key: value.lower() if value in ("True", "False") else value
                for key, value in strings.items()
            },
            cls,
            strict=False,
        )


def topic(robot_id: str, name: str) -> str:
    """A recording's topic: "/mbot/mbot-1/drive"."""
    return f"/mbot/{robot_id}/{name}"
