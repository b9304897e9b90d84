"""`mbot-agent try`: what the updater asks of a release that has yet to show itself."""

import hashlib
import os
from pathlib import Path

import pytest

from mbot_agent.configuration import Board, Configuration, Models
from mbot_agent.daemon import rehearse
from mbot_agent.models.model_directory import ModelDirectory
from mbot_protocol.errors import MbotError

TRAINED = Path(__file__).parents[2] / "models" / "red-cube.onnx"


def configured(models: Path) -> Configuration:
    return Configuration(robot_id="mbot-1", models=Models(directory=str(models)))


def test_without_a_model_nothing_is_made(tmp_path: Path) -> None:
    assert "no model" in rehearse(configured(tmp_path / "models"))
    assert os.listdir(tmp_path) == []  # noqa: PTH208


def test_the_active_model_decides(tmp_path: Path) -> None:
    data = TRAINED.read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    (tmp_path / f"{sha256}.onnx").write_bytes(data)
    ModelDirectory(tmp_path, 5).activate(sha256, "")
    assert "decides" in rehearse(configured(tmp_path))
    (tmp_path / f"{sha256}.onnx").write_bytes(data[:-1])
    with pytest.raises(MbotError):
        rehearse(configured(tmp_path))


def test_a_board_that_the_release_does_not_know_is_found_out_before_it_drives() -> None:
    with pytest.raises(MbotError, match="nocore"):
        rehearse(Configuration(robot_id="mbot-1", board=Board(kind="nocore")))
