from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.models.key_choice import chooser, trusted_keys
from mbot_workstation.fleet.models.key_folder import KeyFolder


@pytest.fixture
def folder(tmp_path: Path) -> KeyFolder:
    return KeyFolder(tmp_path)


def status(*lines: str, unsigned: bool = False) -> Status:
    return Status(robot_id="mbot-1", trusted_keys=lines, accepts_unsigned_models=unsigned)


def choose(folder: KeyFolder, robot: Status, wanted: str = "") -> str | None:
    key = chooser(folder, wanted, lambda _name: "")(robot)
    return None if key is None else key.public.name


def test_the_key_that_the_robot_trusts_signs(folder: KeyFolder) -> None:
    folder.new("anna")
    line = folder.new("bert").line
    assert choose(folder, status(line)) == "bert"
    assert choose(folder, status(line, unsigned=True)) == "bert"


def test_the_robot_may_call_it_something_else(folder: KeyFolder) -> None:
    line = folder.new("anna").line
    assert choose(folder, status(line.replace(" anna", " laptop"))) == "anna"


def test_a_key_may_be_demanded(folder: KeyFolder) -> None:
    lines = [folder.new(name).line for name in ("anna", "bert")]
    assert choose(folder, status(*lines)) == "anna"
    assert choose(folder, status(*lines), "bert") == "bert"
    with pytest.raises(ConfigurationError, match="no key 'carl'"):
        choose(folder, status(*lines), "carl")
    with pytest.raises(RefusedError, match="does not trust your key 'bert': where it was"):
        choose(folder, status(lines[0], unsigned=True), "bert")


def test_without_a_key_it_is_said_how_to_make_one(folder: KeyFolder) -> None:
    with pytest.raises(RefusedError, match="make one with `workstation keys new`"):
        choose(folder, status())
    line = folder.new("anna").line
    with pytest.raises(RefusedError) as caught:
        choose(folder, status())
    assert f'put the line "{line}" into [trust] keys' in str(caught.value)


def test_unsigned_only_where_the_robot_takes_that_and_no_key_would_do(folder: KeyFolder) -> None:
    assert choose(folder, status(unsigned=True)) is None
    folder.new("anna")
    assert choose(folder, status(unsigned=True)) is None


def test_lines_of_a_robot_that_are_no_keys_are_left_out(folder: KeyFolder) -> None:
    key = folder.new("anna")
    assert trusted_keys(status("", "rsa:xyz me", "\x1b[2J", key.line)) == {key.raw}
