import pytest

from mbot_protocol.beat.channels import RobotFacts, topic

from .test_beat_writer import FACTS


def test_the_robot_is_told_in_strings() -> None:
    told = FACTS.to_strings()
    sides = (told["left_reversed"], told["left_trim"], told["right_dead_band"])
    assert sides == ("True", "0.9", "0")
    assert RobotFacts.from_strings(told | {"of_a_later_release": "x"}) == FACTS
    with pytest.raises(ValueError, match=r"wheels\.left\.trim"):
        RobotFacts.from_strings(FACTS.to_strings() | {"left_trim": "much"})
    for rate in ("0", "nan", "inf", "-2"):
        with pytest.raises(ValueError, match="decision_rate_hz"):
            RobotFacts.from_strings(told | {"decision_rate_hz": rate})
    with pytest.raises(ValueError, match="robot_id"):
        RobotFacts.from_strings({})


def test_topics_lie_below_the_robot() -> None:
    assert topic("mbot-1", "drive") == "/mbot/mbot-1/drive"
