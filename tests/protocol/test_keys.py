import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1 import messages_pb2, recordings_pb2
from mbot_protocol.wire import keys
from mbot_protocol.wire.keys import FOXGLOVE_PICTURE, TOPICS, Flow, Right

MESSAGES = {
    **messages_pb2.DESCRIPTOR.message_types_by_name,
    **recordings_pb2.DESCRIPTOR.message_types_by_name,
}


def test_every_message_named_in_the_table_exists_and_carries_a_version() -> None:
    for topic in TOPICS:
        for name in (topic.message, topic.reply):
            if name in ("", FOXGLOVE_PICTURE):
                continue
            message = MESSAGES[name.removeprefix("mbot.v1.")]
            assert message.fields_by_name["schema_version"].number == 1


def test_keys_are_distinct_and_below_the_robots_prefix() -> None:
    assert len({topic.name for topic in TOPICS}) == len(TOPICS)
    for topic in TOPICS:
        assert topic.key("mbot-1").startswith("mbot/mbot-1/")
        assert keys.robot_id_of(topic.key("mbot-1")) == "mbot-1"
        assert (topic.flow is Flow.QUERY) == bool(topic.reply)


@pytest.mark.parametrize("robot_id", ["", "*", "**", "a/b", "Ä", "a b", "A", "-a", "a" * 33])
def test_an_id_that_could_reach_other_robots_is_refused(robot_id: str) -> None:
    with pytest.raises(ConfigurationError, match="expected 1 to 32"):
        keys.check_robot_id(robot_id)


def test_each_key_needs_the_right_that_its_harm_calls_for() -> None:
    for topic in TOPICS:
        if topic.flow is Flow.QUERY:
            changes = topic.name.startswith(("models/", "releases/")) or topic in (
                keys.RECORDING_KEEP,
                keys.RECORDING_REMOVE,
            )
            drives = topic is keys.COMMAND
            assert topic.right is (Right.PUSH if changes else Right.DRIVE if drives else Right.VIEW)


def test_a_workstations_token_is_told_from_another_ones() -> None:
    assert keys.presence_key("mbot-1", "a1") == "mbot/mbot-1/here/a1"
