"""Every output is looked at before the work."""

import os
from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.driving import telemetry
from mbot_workstation.cli.evaluate import evaluate, study
from mbot_workstation.cli.options import check_output_file, check_output_folder
from mbot_workstation.cli.virtual_robot import virtual_robot

from .test_commands import call


def test_what_can_be_written_passes(tmp_path: Path) -> None:
    check_output_file(tmp_path / "new.png", "--plot", (".png",))
    (tmp_path / "old.json").write_text("{}")
    check_output_file(tmp_path / "old.json", "--result")
    check_output_folder(tmp_path / "not" / "there" / "yet", "--output")
    check_output_file(Path("/dev/null"), "--result")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("none/result.json", "--result is .*none/result.json, but there is no folder .*none"),
        (".", "--result is .*, which is a folder; expected a file's name"),
        ("curve.gif", "expected a name that ends in .png or .svg"),
        ("file/below", "there is no folder .*file"),
    ],
)
def test_what_is_in_the_way_is_named(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "file").touch()
    endings = (".png", ".svg") if name.endswith("gif") else ()
    with pytest.raises(ConfigurationError, match=said):
        check_output_file(tmp_path / name, "--result", endings)


def test_a_folder_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="is a file; expected a folder"):
        check_output_folder(tmp_path / "file" / "study", "--output")


def test_a_closed_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        os, "access", lambda *_: False
    )  # root, who may run this, may write anywhere
    with pytest.raises(ConfigurationError, match="may not write"):
        check_output_file(tmp_path / "file", "--result")
    with pytest.raises(ConfigurationError, match="may not write"):
        check_output_folder(tmp_path / "folder", "--output")


@pytest.mark.parametrize(
    ("command", "words", "option"),
    [
        (virtual_robot, (), "--result"),
        (virtual_robot, (), "--record"),
        (virtual_robot, (), "--truth-track"),
        (evaluate, ("servo",), "--plot"),
        (telemetry, (), "--record"),
    ],
)
def test_commands_ask_before_they_begin(
    tmp_path: Path, command, words: tuple[str, ...], option: str
) -> None:
    code, said = call(command, *words, option, str(tmp_path / "none" / "x.png"))
    assert (code, said.startswith(f"{option} is ")) == (2, True)
    assert "no folder" in said


def test_a_study_asks_for_its_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert call(study, "latency", "servo", "-o", str(tmp_path / "file"))[0] == 2
