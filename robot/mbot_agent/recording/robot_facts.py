"""Which robot a recording is of."""

from mbot_agent import installed_version
from mbot_agent.configuration import Configuration
from mbot_protocol.beat.channels import RobotFacts
from mbot_protocol.policy.engine import processor_name


def robot_facts(configuration: Configuration, session_id: int) -> RobotFacts:
    """What a replay has to know besides the beats."""
    return RobotFacts(
        robot_id=configuration.robot_id,
        session_id=session_id,
        software_version=installed_version(),
        processor=processor_name(),
        decision_rate_hz=configuration.control.decision_rate_hz,
        wheels=configuration.motors,
    )
