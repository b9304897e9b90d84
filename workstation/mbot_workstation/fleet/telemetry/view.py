"""The live view of one robot in a terminal: from the window of samples to something to draw."""

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.changes import decision_state
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision, State
from mbot_workstation.fleet.telemetry.stream import LinkState
from mbot_workstation.fleet.telemetry.window import TelemetryWindow
from mbot_workstation.pictures.half_blocks import half_blocks
from mbot_workstation.pictures.picture_file import decode_picture
from mbot_workstation.wording import (
    computer_words,
    fault_lines,
    one_line,
    senses_words,
    short_digest,
)

PICTURE_COLUMNS = 32
BAR_CELLS = 10
"""Characters of an action's bar on either side of zero."""

_STATE_STYLES = {
    State.STATE_RUNNING: "bold green",
    State.STATE_MANUAL: "bold cyan",
    State.STATE_FAULT: "bold red",
    State.STATE_STOPPED: "bold yellow",
}


def link_words(state: LinkState, silence_s: float) -> str:
    """What to say of a link; empty while telemetry arrives."""
    if state is LinkState.LIVE:
        return ""
    daemon = "the daemon is there" if state is LinkState.SILENT else "the daemon is gone"
    return f"no telemetry since {silence_s:.0f} s, {daemon}"


def render(
    robot_id: str, window: TelemetryWindow, link: LinkState, silence_s: float
) -> RenderableType:
    """The whole view.

    Args:
        robot_id: the robot.
        window: its last decisions.
        link: whether telemetry arrives.
        silence_s: time since the last message.

    """
    decision = window.newest
    silence = link_words(link, silence_s)
    body: list[RenderableType] = []
    if silence:
        body.append(Text(silence, style="bold red"))
    if decision is None:
        body.append(Text("waiting for the first decision ..."))
    else:
        body.extend(_faults(decision))
        body.extend(Text(line, style="yellow") for line in fault_lines(decision.notices))
        numbers = Group(_facts(decision, window), "", _latencies(window))
        # In a narrow terminal the picture goes below.
        body.append(Columns([numbers, _picture(window)], padding=(0, 3)))
    return Panel(Group(*body), title=escape(robot_id), title_align="left", expand=False)


def plain_line(robot_id: str, window: TelemetryWindow, link: LinkState, silence_s: float) -> str:
    """One line for a log or a pipe, where no view can be drawn."""
    decision = window.newest
    silence = link_words(link, silence_s)
    if decision is None:
        return f"{robot_id}: {silence or 'waiting for the first decision'}"
    parts = [f"{robot_id}: {decision_state(decision)}", f"decision {decision.sequence}"]
    if (rate_hz := window.decisions_per_s) is not None:
        parts.append(f"{rate_hz:.2f}/s")
    parts.append(f"steps {decision.steps.left:+d} {decision.steps.right:+d}")
    parts.append(f"missed {decision.missed_ticks}")
    parts.append(f"model {short_digest(decision.model_sha256)}")
    parts.extend(f"{s.name} p50 {s.p50_ms:.1f} ms" for s in window.summaries()[-1:])
    parts.extend(fault_lines(decision.faults))
    parts.extend(fault_lines(decision.notices))
    if silence:
        parts.append(silence)
    return ", ".join(parts)


def bar(value: float) -> str:
    """A value in [-1, 1] as a bar that grows from the middle."""
    cells = round(max(-1.0, min(1.0, value)) * BAR_CELLS)
    left = ("█" * max(0, -cells)).rjust(BAR_CELLS)
    right = ("█" * max(0, cells)).ljust(BAR_CELLS)
    return f"{left}│{right}"


def _faults(decision: Decision) -> list[RenderableType]:
    return [Text(line, style="red") for line in fault_lines(decision.faults)]


def _facts(decision: Decision, window: TelemetryWindow) -> Table:
    table = Table.grid(padding=(0, 2))
    word = decision_state(decision)
    table.add_row("state", Text(word, style=_STATE_STYLES.get(decision.state, "bold")))
    told = Beat(decision).at_wheels()
    wheels = (
        ("left", decision.action.left, told[0], decision.steps.left, decision.board_m1),
        ("right", decision.action.right, told[1], decision.steps.right, decision.board_m2),
    )
    asked = decision.HasField("action")
    for name, action, turns, step, level in wheels:
        drawn = bar(action if asked else turns)
        number = f"{action:+.3f}" if asked else "     -"
        table.add_row(name, f"{drawn} {number}  step {step:+4d}  motor {level:+4d}")
    rate_hz = window.decisions_per_s
    rate = "-" if rate_hz is None else f"{rate_hz:.2f}/s"
    table.add_row("decisions", f"{decision.sequence + 1}, {rate}, missed {decision.missed_ticks}")
    table.add_row("records", f"lost {window.lost}, dropped by the robot {decision.dropped_records}")
    table.add_row("model", short_digest(decision.model_sha256))
    table.add_row("computer", computer_words(decision) or "-")
    if decision.HasField("senses"):
        table.add_row("senses", senses_words(decision.senses))
    if window.restarts:
        table.add_row("restarts", f"{window.restarts} while watching")
    return table


def _latencies(window: TelemetryWindow) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("stage")
    table.add_column("p50 ms", justify="right")
    table.add_column("p99 ms", justify="right")
    for summary in window.summaries():
        table.add_row(summary.name, f"{summary.p50_ms:.1f}", f"{summary.p99_ms:.1f}")
    return table


def _picture(window: TelemetryWindow) -> RenderableType:
    if window.picture is None:
        return Text("no picture yet")
    try:
        picture = decode_picture(window.picture.data)
    except ConfigurationError:
        picture = None
    if picture is None:
        return Text(f"no readable picture ({one_line(window.picture.format)})")
    return half_blocks(picture, PICTURE_COLUMNS)
