"""The configuration that a virtual robot writes for its daemon."""

from pathlib import Path

import pytest

from mbot_agent.configuration import load
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.virtual.daemon_config import write_daemon_config

CAMERA, BOARD = "http://127.0.0.1:8090/stream.mjpg", "/run/user/1000/mbot-virtual-board"


@pytest.mark.parametrize("has_deadman", [True, False])
def test_the_daemon_reads_what_was_written(tmp_path: Path, has_deadman: bool) -> None:
    folder = tmp_path / 'a "room" of one\'s own'
    folder.mkdir()
    path = folder / "robot.toml"
    write_daemon_config(path, CAMERA, BOARD, has_deadman=has_deadman)
    found = load(path)
    assert found.robot_id == "virtual"
    assert found.camera.source == CAMERA
    assert (found.board.port, found.board.accept_no_deadman) == (BOARD, not has_deadman)
    assert Path(found.models.directory) == folder / "robot-data" / "models"


def test_a_file_that_fits_keeps_what_was_added_to_it(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    write_daemon_config(path, CAMERA, BOARD, has_deadman=False)
    path.write_text(path.read_text() + "[trust]\n")
    write_daemon_config(path, CAMERA, BOARD, has_deadman=False)
    assert path.read_text().endswith("[trust]\n")


@pytest.mark.parametrize("text", ["", "no toml", '[camera]\nsource = "x"\n[board]\nport = "y"\n'])
def test_another_robots_file_is_left_alone(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=r"is for another robot: expected camera http"):
        write_daemon_config(path, CAMERA, BOARD, has_deadman=False)
    assert path.read_text() == text


def test_a_folder_that_is_missing_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="can't write"):
        write_daemon_config(tmp_path / "no" / "robot.toml", CAMERA, BOARD, has_deadman=False)
