import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from mbot_agent.configuration import load
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.signing.public_key import PublicKey
from mbot_workstation.cli.keys import app

from .pasted import EXAMPLE, pasted


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "home"))
    return tmp_path / "home" / "mbot-agent" / "keys"


def keys(*arguments: str, typed: str = "") -> Result:
    result = CliRunner().invoke(app, arguments, input=typed)
    if isinstance(result.exception, Exception):
        raise result.exception
    return result


def test_a_key_is_made_and_shown(home: Path) -> None:
    made = keys("new", "anna")
    assert str(home / "anna.pem") in made.stdout
    line = keys("show").stdout.strip()
    assert PublicKey.parse(line).name == "anna"
    assert f'\nkeys = ["{line}"]\n' in made.stdout
    assert keys("list").stdout.strip() == line


def test_what_is_printed_fits_into_the_configuration_that_a_robot_has(tmp_path: Path) -> None:
    made = keys("new", "anna").stdout
    line = keys("show", "anna").stdout.strip()
    robot = pasted(made, tmp_path / "config.toml")
    assert load(robot).trust.keys == (line,)
    assert load(robot).trust.release_keys == ()
    robot.write_text(EXAMPLE.read_text())
    keys("trust", str(robot))
    assert load(robot).trust.keys == (line,)


def test_without_a_name_it_has_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("getpass.getuser", lambda: "an na/ß")
    assert json.loads(keys("new", "--json").stdout)["name"] == "anna"


def test_a_passphrase_is_asked_for_twice() -> None:
    keys("new", "lab", "--passphrase", typed="open sesame\nopen sesame\n")
    assert keys("list").stdout.strip().endswith("lab  (passphrase)")
    assert json.loads(keys("list", "--json").stdout)[0]["protected"] is True
    assert keys("new", "two", "--passphrase", typed="one\nother\n").exit_code != 0


def test_no_keys_says_what_to_do() -> None:
    assert "workstation keys new" in keys("list").stdout
    with pytest.raises(ConfigurationError, match="`workstation keys new` makes one"):
        keys("show")


def test_which_of_several_has_to_be_said() -> None:
    keys("new", "anna")
    keys("new", "bert")
    with pytest.raises(ConfigurationError, match="which key"):
        keys("show")
    assert keys("show", "bert").stdout.strip().endswith(" bert")


def test_a_robots_configuration_learns_to_trust(tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text('robot_id = "a"\n')
    keys("new", "anna")
    assert "now trusts anna" in keys("trust", str(robot)).stdout
    assert keys("show").stdout.strip() in robot.read_text()
    assert "trusts anna already" in keys("trust", str(robot), "--key", "anna").stdout
    with pytest.raises(ConfigurationError, match="can't read"):
        keys("trust", str(tmp_path / "none.toml"))
