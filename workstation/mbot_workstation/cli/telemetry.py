"""`workstation telemetry`: watch or record a robot."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_workstation.cli.link_options import LinkOptions, json_option
from mbot_workstation.cli.options import option, output_file, with_options

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mbot_workstation.fleet.telemetry.output import Output

_POLL_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetryOptions(LinkOptions):
    """What `telemetry` takes."""

    record: Path | None = output_file(
        None, "Also record into a new MCAP file.", "--record", metavar="FILE.mcap"
    )
    seconds: float | None = option(
        None, "End by itself after N seconds.", "--seconds", metavar="N", min=0.1
    )
    as_json: bool = json_option()


@with_options
def telemetry(options: TelemetryOptions) -> None:
    """Watch a robot's decisions live, and record them.

    In a terminal a view that redraws itself; in a pipe a line every two seconds; with --json one
    object a decision, stage times in ms after the tick's start. Ctrl-C ends and closes the
    recording.

    Example: `workstation telemetry --robot mbot-1.local --record drive.mcap`
    """
    import sys

    from mbot_protocol.errors import InterruptedByUserError

    count = 0
    try:
        for decisions in _watched(options):
            count = decisions
    except KeyboardInterrupt:
        if options.record is None:
            raise
        raise InterruptedByUserError(_recorded(count, options.record)) from None
    if options.record is not None:
        print(f"workstation: {_recorded(count, options.record)}", file=sys.stderr)


def _recorded(count: int, path: Path) -> str:
    from mbot_workstation.wording import typed

    return (
        f"recorded {count} decisions into {path}; open it in Foxglove, Lichtblick or Rerun, or: "
        f"workstation explain POLICY.onnx --recording {typed(path)}"
    )


def _watched(options: TelemetryOptions) -> "Iterator[int]":
    """Watch and record; yields again and again how many decisions there were."""
    import time
    from contextlib import ExitStack

    from mbot_protocol.v1.messages_pb2 import Decision
    from mbot_workstation.fleet.telemetry.stream import TelemetryStream
    from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile

    count = 0
    with ExitStack() as stack:
        link = stack.enter_context(options.link())
        status = link.status()
        recording = (
            stack.enter_context(TelemetryFile(options.record, link.robot_id))
            if options.record
            else None
        )
        stream = stack.enter_context(TelemetryStream(link, status.decision_rate_hz))
        output = stack.enter_context(_output(link.robot_id, options.as_json))
        until_s = None if options.seconds is None else time.monotonic() + options.seconds
        while until_s is None or time.monotonic() < until_s:
            for sample in stream.poll(_POLL_S):
                output.take(sample)
                count += isinstance(sample.message, Decision)
                if recording is not None:
                    recording.write(sample.message)
            output.refresh(stream.state, stream.silence_s)
            if recording is not None:
                recording.save_if_due()
            yield count


def _output(robot_id: str, as_json: bool) -> "Output":
    import sys

    from rich.console import Console

    from mbot_workstation.fleet.telemetry.output import JsonLines, LiveView, PlainLines

    if as_json:
        return JsonLines(sys.stdout, sys.stderr)
    console = Console()
    return LiveView(robot_id, console) if console.is_terminal else PlainLines(robot_id, sys.stdout)
