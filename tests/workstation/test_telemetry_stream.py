import io
import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_protocol.errors import NewerSchemaError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_protocol.wire.keys import DECISION, OBSERVATION
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.telemetry.output import JsonLines
from mbot_workstation.fleet.telemetry.stream import DEPTH, LinkState, Sample, TelemetryStream
from mbot_workstation.fleet.telemetry.watch import watch

from .fake_robot import FakeRobot
from .samples import decision, picture

WAIT_S = 5.0


@pytest.fixture
def stream(robot: FakeRobot) -> Iterator[TelemetryStream]:
    with RobotLink(robot.address) as link, TelemetryStream(link, 10.0) as stream:
        settle(robot, stream)
        yield stream


def settle(robot: FakeRobot, stream: TelemetryStream) -> None:
    """A subscription takes a moment to reach the robot: publish until it has."""
    until_s = time.monotonic() + WAIT_S
    while time.monotonic() < until_s:
        robot.publish(decision())
        if stream.poll(0.1):
            time.sleep(0.05)
            stream.poll()
            return
    pytest.fail("no telemetry arrived")


def wait_for(stream: TelemetryStream, count: int) -> list[Sample]:
    samples: list[Sample] = []
    until_s = time.monotonic() + WAIT_S
    while len(samples) < count and time.monotonic() < until_s:
        samples += stream.poll(0.1)
    return samples


def wait_for_state(stream: TelemetryStream, state: LinkState) -> None:
    until_s = time.monotonic() + WAIT_S
    while stream.state is not state and time.monotonic() < until_s:
        stream.poll(0.05)
    assert stream.state is state


def test_decisions_and_pictures_arrive_typed(robot: FakeRobot, stream: TelemetryStream) -> None:
    robot.publish(picture())
    robot.publish(decision(7))
    messages = [sample.message for sample in wait_for(stream, 2)]
    assert picture() in messages
    assert decision(7) in messages


def test_a_slow_reader_gets_the_newest(robot: FakeRobot, stream: TelemetryStream) -> None:
    for sequence in range(DEPTH + 20):
        robot.publish(decision(sequence))
    time.sleep(0.3)
    sequences = [s.message.sequence for s in stream.poll() if isinstance(s.message, Decision)]
    assert sequences == list(range(20, DEPTH + 20))


def test_malformed_records_are_counted_and_left_out(
    robot: FakeRobot, stream: TelemetryStream
) -> None:
    robot.publish(b"\xff\xff", DECISION)
    robot.publish(b"\xff\xff", OBSERVATION)
    robot.publish(decision(1))
    assert [sample.message for sample in wait_for(stream, 1)] == [decision(1)]
    assert stream.malformed == 2


def test_a_newer_schema_is_told(robot: FakeRobot, stream: TelemetryStream) -> None:
    robot.publish(Decision(schema_version=9))
    with pytest.raises(NewerSchemaError):
        wait_for(stream, 1)


def test_silence_is_noticed_after_three_periods(robot: FakeRobot, stream: TelemetryStream) -> None:
    robot.publish(decision(1))
    wait_for(stream, 1)
    assert stream.state is LinkState.LIVE
    wait_for_state(stream, LinkState.SILENT)
    assert stream.silence_s > 0.3


@pytest.mark.slow
def test_a_restart_of_the_robot_is_survived() -> None:
    with FakeRobot() as first, RobotLink(first.address) as link, TelemetryStream(link) as stream:
        settle(first, stream)
        first.__exit__(None, None, None)
        wait_for_state(stream, LinkState.GONE)
        with FakeRobot(port=first.port) as second:
            settle(second, stream)
            assert stream.state is LinkState.LIVE


def test_what_is_watched_is_counted_shown_and_recorded(robot: FakeRobot, tmp_path: Path) -> None:
    out, path, count = io.StringIO(), tmp_path / "drive.mcap", 0
    with RobotLink(robot.address) as link:
        for count in watch(link, JsonLines(out, io.StringIO()), path, seconds=1.5):
            if count < 3:
                robot.publish(decision(count))
    shown = [json.loads(line) for line in out.getvalue().splitlines()]
    assert count == len(shown) >= 3
    assert path.stat().st_size > 0
