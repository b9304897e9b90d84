"""Which robot a recording is of."""

from mbot_agent import installed_version
from mbot_agent.configuration import Configuration
from mbot_protocol.beat.drive_record import RobotFacts
from mbot_protocol.policy.engine import processor_name


def robot_facts(configuration: Configuration, session_id: int) -> RobotFacts:
    """What a replay has to know besides the beats."""
    wheels = configuration.motors.to_maps()
    return RobotFacts(
        robot_id=configuration.robot_id,
        session_id=session_id,
        software_version=installed_version(),
        processor=processor_name(),
        decision_rate_hz=configuration.control.decision_rate_hz,
        left_reversed=wheels.left.reversed,
        left_trim=wheels.left.trim,
        left_dead_band=wheels.left.dead_band,
        right_reversed=wheels.right.reversed,
        right_trim=wheels.right.trim,
        right_dead_band=wheels.right.dead_band,
    )
