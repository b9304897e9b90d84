"""The Rerun viewer's side: without Rerun one line, with it a file that holds the drive."""

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision, Fault, State
from mbot_workstation.commands.subcommands import app
from mbot_workstation.commands.view_drives import ViewOptions
from mbot_workstation.drives.rerun_view import RerunView, changes

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"


def test_without_rerun_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigurationError, match=r"view needs rerun.*\[view\]"):
        RerunView(["mbot-1"])
    assert not ViewOptions().web


def test_what_changed_is_told_once() -> None:
    first = Decision(model_sha256="ab" * 32, state=State.STATE_RUNNING, stop_count=1)
    assert changes(None, first) == [("INFO", "model abababababab"), ("INFO", "now running")]
    assert changes(first, first) == []
    fault = Fault(kind="stuck", detail="the picture stands still")
    then = Decision(model_sha256="ab" * 32, state=State.STATE_STOPPED, stop_count=2, faults=[fault])
    assert changes(first, then) == [
        ("INFO", "now stopped"),
        ("ERROR", "stuck: the picture stands still"),
        ("WARN", "stop 2"),
    ]


def test_a_recording_becomes_a_file_for_the_viewer(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    result = CliRunner().invoke(app, ["view", str(RECORDED), "--save", str(path)])
    assert result.exit_code == 0, result.output
    data = path.read_bytes()
    assert len(data) > 50_000
    for name in (b"virtual/observation", b"virtual/wheels/left", b"virtual/log", b"robot_time"):
        assert name in data
