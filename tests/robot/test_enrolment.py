from pathlib import Path

import pytest

from mbot_agent.configuration import Configuration, Network, decode
from mbot_agent.configuration_files import ENROLMENT_FILE, enrolled
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.keys import Right

ENROLMENT = """
robot_id = "mbot-1"
[network]
listen = ["tls/0.0.0.0:7447"]
[network.tls]
ca = "/tls/ca.pem"
certificate = "/tls/robot.pem"
key = "/tls/robot.key"
[access.people]
rosa = ["drive", "push"]
"""


@pytest.fixture
def origin(tmp_path: Path) -> Path:
    (tmp_path / ENROLMENT_FILE).write_text(ENROLMENT)
    return tmp_path / "config.toml"


def test_without_the_file_nothing_changes(tmp_path: Path) -> None:
    configuration = Configuration(robot_id="mbot-1")
    assert enrolled(configuration, tmp_path / "config.toml") is configuration


def test_it_takes_the_place_of_network_and_people(origin: Path) -> None:
    configuration = Configuration(robot_id="mbot-1", network=Network(connect=("tcp/127.0.0.1:1",)))
    found = enrolled(configuration, origin)
    assert found.network.listen == ("tls/0.0.0.0:7447",)
    assert found.network.connect == ()
    assert found.access.people == {"rosa": (Right.DRIVE, Right.PUSH)}


def test_another_robots_is_refused(origin: Path) -> None:
    with pytest.raises(
        ConfigurationError, match=r"is for robot 'mbot-1', but robot_id in .*mbot-2"
    ):
        enrolled(Configuration(robot_id="mbot-2"), origin)


def test_people_in_both_files_are_refused(origin: Path) -> None:
    text = ENROLMENT.replace("rosa", "max")
    with pytest.raises(ConfigurationError, match="delete one of the two"):
        enrolled(decode(text, "config.toml"), origin)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("[network]", "[netwrok]"), "netwrok"),
        (("rosa", "Rosa"), "expected 1 to 32"),
        (("drive", "fly"), "fly"),
        (('rosa = ["drive", "push"]', ""), "nobody could talk"),
        (("tls/0.0.0.0", "tcp/0.0.0.0"), "anyone on the network"),
        ((ENROLMENT, "robot_id ="), "no valid TOML"),
    ],
)
def test_a_mistake_names_the_file(origin: Path, changed: tuple[str, str], words: str) -> None:
    path = origin.with_name(ENROLMENT_FILE)
    path.write_text(ENROLMENT.replace(*changed))
    with pytest.raises(ConfigurationError) as caught:
        enrolled(Configuration(robot_id="mbot-1"), origin)
    assert str(path) in str(caught.value)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
