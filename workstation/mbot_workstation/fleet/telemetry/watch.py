"""Watching a robot's telemetry, and recording it."""

import time
from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path

from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.telemetry.output import Output
from mbot_workstation.fleet.telemetry.stream import TelemetryStream
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile

_POLL_S = 0.1


def watch(
    link: RobotLink, output: Output, record: Path | None, seconds: float | None
) -> Generator[int]:
    """Show what comes; yields again and again how many decisions there were.

    Args:
        link: to the robot.
        output: what shows it.
        record: a new MCAP file, if it is to be recorded.
        seconds: how long; None: until it is interrupted.

    Raises:
        MbotError: the robot does not answer, or the file can't be written.

    """
    count = 0
    with ExitStack() as stack:
        status = link.status()
        recording = stack.enter_context(TelemetryFile(record, link.robot_id)) if record else None
        stream = stack.enter_context(TelemetryStream(link, status.decision_rate_hz))
        stack.enter_context(output)
        until_s = None if seconds is None else time.monotonic() + seconds
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
