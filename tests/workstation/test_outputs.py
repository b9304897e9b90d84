"""Where telemetry and sessions of maneuvers are shown: lines, JSON, a terminal."""

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from mbot_protocol.errors import MbotError
from mbot_workstation.fleet.link.address import Destination, parse_address
from mbot_workstation.fleet.telemetry.output import JsonLines, LiveView, PlainLines
from mbot_workstation.fleet.telemetry.stream import LinkState, Sample
from mbot_workstation.learn.evaluation.provenance import digest, provenance
from mbot_workstation.learn.learning.git_state import GitState
from mbot_workstation.measure.maneuvers.plan import Order, plan
from mbot_workstation.measure.maneuvers.terminal import PlainDisplay, TerminalDisplay
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.virtual.child import Child

from .samples import decision


def test_scripts_get_an_object_a_decision_and_words_about_the_link() -> None:
    out, errors = io.StringIO(), io.StringIO()
    with JsonLines(out, errors) as lines:
        lines.take(Sample(decision(7), 1.0))
        lines.refresh(LinkState.GONE, 3.0)
        lines.refresh(LinkState.GONE, 4.0)
        lines.refresh(LinkState.LIVE, 0.0)
    assert json.loads(out.getvalue())["sequence"] == 7
    assert len(errors.getvalue().splitlines()) == 2
    assert "telemetry is back" in errors.getvalue()


def test_a_pipe_gets_a_line_every_two_seconds() -> None:
    out, now_s = io.StringIO(), [0.0]
    with PlainLines("mbot-1", out, lambda: now_s[0]) as lines:
        lines.take(Sample(decision(), 1.0))
        for at_s in (0.5, 1.9, 2.0, 2.1, 4.0):
            now_s[0] = at_s
            lines.refresh(LinkState.LIVE, 0.0)
    assert len(out.getvalue().splitlines()) == 2
    assert out.getvalue().startswith("mbot-1: ")


def test_a_terminal_keeps_the_view_within_80_columns() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    with LiveView("mbot-1", console) as view:
        view.take(Sample(decision(), 1.0))
        view.refresh(LinkState.LIVE, 0.0)
    assert isinstance(console.file, io.StringIO)
    assert "mbot-1" in console.file.getvalue()


def test_a_session_of_maneuvers_is_told_in_lines_or_as_a_bar() -> None:
    first = plan(MANEUVERS, 1, Order.LISTED, seed=0)[0]
    out = io.StringIO()
    plain = PlainDisplay(out)
    plain.next_run(first, 0, 8)
    plain.recorded(first, 1)
    assert out.getvalue().startswith(f"1 of 8: {first.maneuver.name}, repetition 1")
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    with TerminalDisplay(console) as display:
        display.next_run(first, 0, 8)
        display.countdown(1.0)
        display.driving()
        display.recorded(first, 1)
        display.say("carried back")


def test_a_program_that_ends_early_is_named_with_its_last_words(tmp_path: Path) -> None:
    log = tmp_path / "log" / "program.log"
    log.parent.mkdir()
    with Child("workstation", ["no-such-command"], log) as child:
        with pytest.raises(MbotError, match="ended early"):
            child.wait_until(lambda: False, 60.0, "nothing started")
        assert child.exit_code == 2
    assert "no-such-command" in log.read_text()


def test_results_name_the_policys_digest(tmp_path: Path) -> None:
    path = tmp_path / "first.onnx"
    path.write_bytes(b"policy")
    assert provenance([str(path), "servo"]).startswith(f"Policy: first `{digest(path)}`; commit ")
    assert provenance(["servo"]).startswith("Policy: none; commit ")
    assert len(digest(path)) == 12


def test_pages_and_policies_are_no_changes_of_code() -> None:
    for changed, said in (
        (("docs/results/blur.md", "models/red-cube.onnx"), "commit `0123456`."),
        (("models/objects/green-ball.toml",), "commit `0123456`, with changes."),
        (("docs/results/blur.md", "robot/mbot_agent/main.py"), "commit `0123456`, with changes."),
    ):
        assert provenance([], GitState("0123456789" * 4, changed)).endswith(said)


def test_an_address_alone_is_anybody_there() -> None:
    there = Destination(parse_address("mbot-1.local"))
    assert (there.robot_id, there.security) == (None, None)
