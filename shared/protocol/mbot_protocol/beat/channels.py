"""What stands in a recording of a drive: its topics, and which robot it was."""

import math

import msgspec

from mbot_protocol.drive.actions import MotorMap, WheelMaps

DECISION_TOPIC, DRIVE_TOPIC = "decision", "drive"
OBSERVATION_TOPIC, CAMERA_TOPIC, LOG_TOPIC = "observation", "camera", "log"
POSE_TOPIC = "pose"

ROBOT_METADATA = "mbot.robot"
"""The metadata record of a recording that says which robot it was: `RobotFacts` as strings."""

_SIDES = ("left", "right")


class RobotFacts(msgspec.Struct, frozen=True):
    """Whose recording this is, and what turns an action of its policy into the board's speeds.

    Attributes:
        robot_id, session_id: as in Decision.
        software_version: of mbot-agent.
        processor: what has computed; another one may differ in the last digits.
        decision_rate_hz: beats a second.
        wheels: how steps became the motors' duties; "left_trim" and the like in a file.

    """

    robot_id: str
    session_id: int
    software_version: str
    processor: str
    decision_rate_hz: float
    wheels: WheelMaps

    def to_strings(self) -> dict[str, str]:
        """As MCAP keeps metadata."""
        fields = msgspec.structs.asdict(self)
        for side in _SIDES:
            motor = msgspec.structs.asdict(getattr(self.wheels, side))
            fields |= {f"{side}_{name}": value for name, value in motor.items()}
        del fields["wheels"]
        return {name: str(value) for name, value in fields.items()}

    @classmethod
    def from_strings(cls, strings: dict[str, str]) -> "RobotFacts":
        """Read what `to_strings` wrote.

        Raises:
            ValueError: a value is missing or of another kind; it says which.

        """
        fields = {
            key: value.lower() if value in ("True", "False") else value
            for key, value in strings.items()
        }
        wheels = {
            side: {
                name: fields[key]
                for name in MotorMap.__struct_fields__
                if (key := f"{side}_{name}") in fields
            }
            for side in _SIDES
        }
        facts = msgspec.convert(fields | {"wheels": wheels}, cls, strict=False)
        if not 0 < facts.decision_rate_hz < math.inf:
            raise ValueError(f"decision_rate_hz is {facts.decision_rate_hz}")
        return facts


def topic(robot_id: str, name: str) -> str:
    """A recording's topic: "/mbot/mbot-1/drive"."""
    return f"/mbot/{robot_id}/{name}"
