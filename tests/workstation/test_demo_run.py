"""The demonstration without its programs: what it writes, waits for, drives and sums up."""

import io
import json
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from mbot_agent.configuration import load
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.errors import ConfigurationError, MbotError, RefusedError
from mbot_protocol.v1.messages_pb2 import Decision, Fault, Status
from mbot_protocol.wire.keys import STATUS
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.telemetry.output import PlainLines
from mbot_workstation.fleet.telemetry.stream import LinkState, TelemetryStream
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.look.demo.demo_result import SUCCESS_TOUCHES, summarise
from mbot_workstation.look.demo.demo_run import ENOUGH_TOUCHES, DemoSettings, drive, run_demo
from mbot_workstation.tasks.fetch.episode import Happening
from mbot_workstation.virtual.live_world import TaskEvent
from mbot_workstation.virtual.trajectory import TrajectoryWriter
from mbot_workstation.virtual.with_daemon import (
    ROBOT_LOG,
    DaemonSettings,
    blocking_faults,
    daemon_configuration,
)

from .fake_robot import FakeRobot
from .samples import decision

LIMIT_S = 20.0


def settings(folder: Path, seconds: float = LIMIT_S, *virtual_robot: str) -> DemoSettings:
    return DemoSettings(folder / "model.onnx", folder, seconds, virtual_robot)


# Before


def test_a_demo_that_did_not_start_does_not_stand_in_the_way_of_the_next(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    for _ in range(2):
        with pytest.raises(MbotError, match="robot did not start"):
            run_demo(settings(folder, 1, "--panorama", "missing.jpg"), quiet())
    assert "missing.jpg" in (folder / ROBOT_LOG).read_text()
    with pytest.raises(ConfigurationError, match="can't make"):
        run_demo(settings(folder / ROBOT_LOG / "x"), quiet())


def test_a_robot_toml_of_ones_own_is_not_an_earlier_demo(tmp_path: Path) -> None:
    mine = tmp_path / "robot.toml"
    mine.write_text("robot_id = 'mbot-1'")
    with pytest.raises(ConfigurationError, match=r"holds other things, such as robot\.toml"):
        run_demo(settings(tmp_path), quiet())
    assert mine.exists()


@pytest.mark.parametrize("accepted", [True, False])
def test_the_daemon_reads_what_the_demo_writes(tmp_path: Path, accepted: bool) -> None:
    places = {"camera": "http://127.0.0.1:8090/stream.mjpg", "board": "/tmp/x/board"}
    key = SigningKey.ephemeral("demo").public.line
    nothing_for_it = tmp_path / "calibration"
    nothing_for_it.mkdir()
    made = DaemonSettings("virtual-mbot", nothing_for_it, accepted)
    path = tmp_path / "robot.toml"
    path.write_text(daemon_configuration(made, places, tmp_path / "models", key, "127.0.0.1:7"))
    found = load(path)
    assert {"camera": found.camera.source, "board": found.board.port} == places
    assert found.board.accept_no_deadman == accepted
    assert list(found.trust.keys) == [key]
    assert list(found.network.listen) == ["tcp/127.0.0.1:7"]
    assert (found.models.directory, found.calibration) == (str(tmp_path / "models"), "")


def test_all_faults_but_the_missing_model_are_waited_for(robot: FakeRobot) -> None:
    faults: list[str] = []

    def status(_: bytes) -> Status:
        told = robot.status()
        told.faults.extend(Fault(kind=kind) for kind in faults)
        return told

    robot.replies[STATUS.name] = status
    with RobotLink(robot.address) as link:
        faults[:] = ["no-model", "camera-stalled"]
        assert blocking_faults(link) == ["camera-stalled"]
        faults[:] = ["no-model"]
        assert blocking_faults(link) == []
        faults[:] = ["board-no-deadman", "no-model"]
        with pytest.raises(RefusedError, match=r"\(mbot-agent 1\).* --accept-no-deadman lets it"):
            blocking_faults(link)


# Driving


class Stage:
    """A robot that decides ten times a second, and all that `drive` takes."""

    def __init__(self, robot: FakeRobot, folder: Path, resources: ExitStack) -> None:
        self.link = resources.enter_context(RobotLink(robot.address))
        self.stream = resources.enter_context(TelemetryStream(self.link))
        self.file = folder / "recording.mcap"
        self.recording = resources.enter_context(TelemetryFile(self.file, robot.robot_id))
        self.folder = folder

    def drive(self, seconds: float, output: PlainLines) -> list[Decision]:
        made = settings(self.folder, seconds)
        return drive(self.link, self.stream, self.recording, output, made, self.folder)


@contextmanager
def stage(robot: FakeRobot, folder: Path) -> Iterator[Stage]:
    stop = threading.Event()

    def decide() -> None:
        sequence = 0
        while not stop.wait(0.02):
            sequence += 1
            made = decision(sequence)
            if sequence % 2:
                made.ClearField("action")  # it stood
            robot.publish(made)

    thread = threading.Thread(target=decide)
    with ExitStack() as resources:
        resources.callback(thread.join)
        resources.callback(stop.set)
        made = Stage(robot, folder, resources)
        thread.start()
        yield made


def actions(robot: FakeRobot) -> list[str | None]:
    return [command.WhichOneof("action") for command in robot.commands()]


def quiet() -> PlainLines:
    return PlainLines("mbot-1", io.StringIO())


def test_it_drives_for_its_time_and_records_what_it_saw(robot: FakeRobot, tmp_path: Path) -> None:
    with stage(robot, tmp_path) as made:
        began_s = time.monotonic()
        decisions = made.drive(1.0, quiet())
        assert 1.0 <= time.monotonic() - began_s < LIMIT_S
    assert actions(robot) == ["run", "stop"]
    assert robot.commands()[0].run.when_ready
    assert decisions
    assert all(one.HasField("action") for one in decisions)
    recorded = [beat.decision for beat in read_drive(made.file).beats]
    assert [m for m in recorded if m.HasField("action")] == decisions
    assert len(recorded) > len(decisions)


def test_ten_objects_are_enough(robot: FakeRobot, tmp_path: Path) -> None:
    with TrajectoryWriter(tmp_path / "trajectory.jsonl") as writer:
        for happening in (Happening.TIME_OUT, *[Happening.TOUCH] * ENOUGH_TOUCHES):
            writer.add_event(TaskEvent(1.0, happening, 0.0, {}))
    with stage(robot, tmp_path) as made:
        began_s = time.monotonic()
        made.drive(LIMIT_S, quiet())
        assert time.monotonic() - began_s < LIMIT_S / 2
    assert actions(robot) == ["run", "stop"]


class Interrupted(PlainLines):
    """A person has seen enough."""

    def refresh(self, link: LinkState, silence_s: float) -> None:
        raise KeyboardInterrupt


def test_the_robot_is_stopped_whatever_ends_the_drive(robot: FakeRobot, tmp_path: Path) -> None:
    with stage(robot, tmp_path) as made, pytest.raises(KeyboardInterrupt):
        made.drive(LIMIT_S, Interrupted("mbot-1", io.StringIO()))
    assert actions(robot) == ["run", "stop"]


# After


def result_file(folder: Path, touches: int) -> None:
    run = {"touches": touches, "distance_driven_m": 4.2, "score": 7.5}
    (folder / "result.json").write_text(json.dumps(run))


def test_the_summary_is_of_the_decisions_that_reached_the_board(tmp_path: Path) -> None:
    decisions = [decision(number) for number in range(101)]
    for number, one in enumerate(decisions):
        one.missed_ticks = 3 + number // 50
        one.acknowledged_monotonic_ns = one.started_monotonic_ns + number * 1_000_000
        one.resident_memory_bytes = (150 + number) * 2**20
    decisions[0].acknowledged_monotonic_ns = 0  # the board was silent
    board = Status(board_version="stock 6", board_has_deadman=False)
    for touches in (SUCCESS_TOUCHES, SUCCESS_TOUCHES - 1):
        result_file(tmp_path, touches)
        found = summarise(tmp_path, decisions, 30.04, 0.123456, 1.239, board)
        assert (found.touches, found.success) == (touches, touches >= SUCCESS_TOUCHES)
    assert (found.distance_driven_m, found.score) == (4.2, 7.5)
    assert (found.decisions, found.missed_ticks) == (101, 2)
    assert found.decision_p50_ms == pytest.approx(50, abs=1)
    assert found.decision_p99_ms == pytest.approx(99, abs=1)
    # A frame is 30 ms old when its decision starts.
    assert found.frame_p50_ms == pytest.approx(found.decision_p50_ms + 30)
    assert found.frame_p99_ms == pytest.approx(found.decision_p99_ms + 30)
    assert (found.agent_memory_mb, found.agent_cpu_share) == (250.0, 0.1235)
    assert (found.driven_s, found.push_s) == (30.0, 1.24)
    assert (found.board_version, found.board_has_deadman) == ("stock 6", False)


def test_a_policy_that_never_drove_is_said(tmp_path: Path) -> None:
    result_file(tmp_path, 0)
    silent = decision()
    silent.acknowledged_monotonic_ns = 0
    for decisions in ([], [silent]):
        with pytest.raises(MbotError, match=r"the policy never drove, see .*agent\.log"):
            summarise(tmp_path, decisions, 1.0, 0.0, 0.0, Status())
