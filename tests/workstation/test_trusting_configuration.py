import tomllib
from pathlib import Path

import pytest

from mbot_agent.configuration import decode
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.signing.public_key import PublicKey
from mbot_workstation.fleet.models.trusting_configuration import with_trusted_key

ANNA, BERT = PublicKey(bytes(32), "anna"), PublicKey(bytes(range(32)), "bert")
EXAMPLE = Path(__file__).parents[2] / "deploy" / "config.toml"


@pytest.mark.parametrize(
    "text",
    [
        "",
        'robot_id = "a"',
        'robot_id = "a"\n[trust]\n',
        'robot_id = "a"\n[trust]\nallow_unsigned = false\n[models]\nkeep = 3\n',
        'robot_id = "a"\n[trust] # whose models\nkeys = []\n',
        f'robot_id = "a"\n[trust]\nkeys = ["{BERT.line}"]\n',
        f'robot_id = "a"\n  [trust]\n  keys = [\n    "{BERT.line}",  # Bert\n  ]\n[models]\nkeep=3',
        f"[trust]\nkeys = [ '{BERT.line}' ]",
        '[models]\nkeys = []\n[trust]\nkeys=[\n]\n[other]\nkeys = ["x"]',
        EXAMPLE.read_text(),
    ],
)
def test_only_the_key_is_added(text: str) -> None:
    before, changed = tomllib.loads(text), with_trusted_key(text, ANNA, "robot.toml")
    after = tomllib.loads(changed)
    old = before.get("trust", {}).get("keys", [])
    assert after["trust"]["keys"] == [ANNA.line, *old]
    assert after | {"trust": before.get("trust")} == before | {"trust": before.get("trust")}
    comments = [line for line in text.splitlines() if line.lstrip().startswith("#")]
    assert [line for line in changed.splitlines() if line.lstrip().startswith("#")] == comments
    assert with_trusted_key(changed, ANNA, "robot.toml") == changed


def test_the_robots_daemon_reads_it() -> None:
    changed = with_trusted_key(EXAMPLE.read_text(), ANNA, "robot.toml")
    assert decode(changed, "robot.toml").trust.public_keys == (ANNA,)


@pytest.mark.parametrize(
    "text", ["trust = { keys = [] }", "trust.keys = []", '[trust]\n"keys" = []']
)
def test_what_it_does_not_understand_is_left_to_a_person(text: str) -> None:
    with pytest.raises(ConfigurationError, match=f'add "{ANNA.line}"'.replace("+", r"\+")):
        with_trusted_key(text, ANNA, "robot.toml")


def test_a_file_of_another_kind_is_left_as_it_is() -> None:
    objects = '[[object]]\nname = "ball"\nshape = "ball"\nwidth_mm = 100\ncolour = "#1e9632"\n'
    for text in (objects, "mass_kg = 0.4\n[camera]\nwidth_px = 320\n"):
        with pytest.raises(ConfigurationError, match="neither robot_id nor"):
            with_trusted_key(text, ANNA, "objects.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robot_id =", "not valid TOML"),
        ("trust = 3", "not a list of lines"),
        ("[trust]\nkeys = 3", "not a list of lines"),
        ("[trust]\nkeys = [3]", "not a list of lines"),
        ('[trust]\nkeys = ["x"]', "is not a signing key"),
    ],
)
def test_a_mistake_in_the_file_is_named(text: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        with_trusted_key(text, ANNA, "robot.toml")
