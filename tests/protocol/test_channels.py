import pytest

from mbot_protocol.beat.channels import RobotFacts, topic

from .test_beat_writer import FACTS


def test_the_robot_is_told_in_strings() -> None:
    assert RobotFacts.from_strings(FACTS.to_strings()) == FACTS
    with pytest.raises(ValueError, match="left_trim"):
        RobotFacts.from_strings(FACTS.to_strings() | {"left_trim": "much"})
    with pytest.raises(ValueError, match="robot_id"):
        RobotFacts.from_strings({})


def test_topics_lie_below_the_robot() -> None:
    assert topic("mbot-1", "drive") == "/mbot/mbot-1/drive"
