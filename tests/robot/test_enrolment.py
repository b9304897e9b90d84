from pathlib import Path

import pytest

from mbot_agent.configuration import Configuration, Network, TrustSettings, decode
from mbot_agent.configuration_files import (
    ENROLMENT_FILE,
    TRUSTED_KEYS_FILE,
    complete,
    enrolled,
    keys_by_file,
    trusting,
)
from mbot_agent.doctor import examine_trust
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.wire.keys import Right

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

ANNA, BERT = PublicKey(bytes(32), "anna"), PublicKey(bytes(range(32)), "bert")


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
        ((ENROLMENT, "robot_id ="), "not valid TOML"),
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


def send_keys(origin: Path, *lines: str) -> Path:
    path = origin.with_name(TRUSTED_KEYS_FILE)
    path.write_text(f"keys = {list(lines)}")
    return path


def test_keys_that_were_sent_are_trusted_beside_those_of_the_configuration(origin: Path) -> None:
    configuration = Configuration("mbot-1", trust=TrustSettings(keys=(ANNA.line,)))
    assert trusting(configuration, origin) is configuration
    send_keys(origin, ANNA.line.replace("anna", "ann"), BERT.line, BERT.line)
    found = trusting(configuration, origin)
    assert found.trust.public_keys == (ANNA, BERT)
    assert found.trust.release_keys == ()
    assert not found.trust.allow_unsigned


def test_everything_beside_the_configuration_completes_it(origin: Path) -> None:
    origin.write_text('robot_id = "mbot-1"')
    send_keys(origin, BERT.line)
    found = complete(origin)
    assert found.trust.public_keys == (BERT,)
    assert found.access.people == {"rosa": (Right.DRIVE, Right.PUSH)}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f'release_keys = ["{ANNA.line}"]\nkeys = []', "release_keys is unknown"),
        ("allow_unsigned = true\nkeys = []", "allow_unsigned is unknown"),
        ("", "keys is missing"),
        ('keys = ["anna"]', "'anna' is not a signing key"),
        ("keys =", "not valid TOML"),
    ],
)
def test_a_file_of_keys_holds_nothing_else(origin: Path, text: str, words: str) -> None:
    path = origin.with_name(TRUSTED_KEYS_FILE)
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=words) as caught:
        trusting(Configuration("mbot-1"), origin)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_check_says_which_key_is_from_which_file(origin: Path) -> None:
    origin.write_text('robot_id = "mbot-1"')
    nobody = examine_trust(complete(origin), keys_by_file(origin))
    assert (nobody.verdict, nobody.detail) == (
        "warning",
        "no key, so no model is taken: `workstation keys new` makes one and says how it gets here",
    )
    origin.write_text(f'robot_id = "mbot-1"\n[trust]\nkeys = ["{ANNA.line}"]')
    sent = send_keys(origin, ANNA.line, BERT.line)
    found = examine_trust(complete(origin), keys_by_file(origin))
    assert (found.verdict, found.detail) == (
        "ok",
        f"takes models signed by anna ({origin}), anna, bert ({sent})",
    )
