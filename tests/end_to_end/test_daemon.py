"""The real daemon as a process, between a fake board and a camera stream."""

import os
import signal
import socket
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest

from mbot_protocol.daemon_state import FILE, DaemonState
from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import Command, CommandReply, MotorMap, Run, Stop
from mbot_protocol.wire.keys import COMMAND, STATUS
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.stored_models import activate
from mbot_workstation.fleet.telemetry.stream import TelemetryStream

from ..ran import ran
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .daemon_watch import resident_mb
from .processes import (
    LONGER_THAN_FORGIVEN_S,
    PROGRAMS,
    Daemon,
    Process,
    beats_on,
    until,
    workstation,
)

FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)

OWN_MB, MEMORY_MB = 47, 120
"""What no one else could use, measured 45.0 to 45.3 with a policy that has no memory of its own;
and everything, README's bar. The rest are pages of libraries, of which the kernel counts as many
as it happens to hold of their files: 63.9 to 65.1 MB here, 67 in a fresh clone."""


def test_from_push_to_driving_to_stop(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        assert not board.moved
        daemon.push(FORWARD)
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD)
        with daemon.link() as link:
            with TelemetryStream(link, 2.5) as stream:
                assert until(lambda: any(True for _ in stream.poll(0.2)))
            RemoteControl(link).stop()
        assert board.wait_for(0, 0)
        assert beats_on(daemon.status)
        assert board.speeds == (0, 0)


def test_a_daemon_that_starts_stops_the_board_before_it_does_anything_else(
    daemon: Daemon, board: FakeBoard
) -> None:
    """Before it looks for its camera, and before anybody can talk to it."""
    host, port = daemon.address.split(":")
    with socket.create_server(("127.0.0.1", daemon.camera_port)) as camera, daemon.start():
        camera.settimeout(20)
        _, _ = camera.accept()
        looked_s = time.monotonic()

        def listens() -> bool:
            with suppress(OSError), socket.create_connection((host, int(port)), timeout=1):
                return True
            return False

        assert until(listens, 20)
        heard_s = time.monotonic()
        assert until(lambda: board.commands)
    stopped_s, *speeds = board.commands[0]
    assert speeds == [0, 0]
    assert stopped_s < looked_s < heard_s


def test_it_fits_a_small_computer(daemon: Daemon, board: FakeBoard) -> None:
    """README: memory. OpenSSL would be 4 MB of it that nothing asks for."""
    with daemon.camera(), daemon.start() as process:
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD)
        with daemon.link() as link, TelemetryStream(link, 2.5) as stream:
            assert until(lambda: any(True for _ in stream.poll(0.2)))
        assert resident_mb(process.pid, "RssAnon") < OWN_MB
        assert resident_mb(process.pid) < MEMORY_MB
        loaded = Path(f"/proc/{process.pid}/maps").read_text()
        assert "/_hashlib." not in loaded
        assert "/_ssl." not in loaded


def test_a_hand_drives_and_lets_go(daemon: Daemon, board: FakeBoard, tmp_path: Path) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        arguments = ("drive", "0.5", "-0.5", "--for", "1", "--robot", daemon.address)
        with workstation(*arguments, log=tmp_path / "drive.log") as hand:
            assert board.wait_for(-148, -148, timeout_s=15)
            assert hand.wait() == 0
        assert board.wait_for(0, 0)


def test_root_can_read_whether_its_wheels_may_turn(
    daemon: Daemon, board: FakeBoard, tmp_path: Path
) -> None:
    path = tmp_path / "run" / FILE
    path.parent.mkdir()

    def told() -> DaemonState | None:
        return DaemonState.from_bytes(path.read_bytes()) if path.exists() else None

    where = {"RUNTIME_DIRECTORY": str(path.parent)}
    with daemon.camera(), daemon.start(environment=where) as process:
        assert daemon.is_up()
        assert until(lambda: (now := told()) is not None and now.faults == ("no-model",))
        daemon.push(FORWARD)
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD)
        assert until(lambda: (now := told()) is not None and now.armed and not now.faults)
        assert (now := told()) is not None
        assert now.pid == process.pid
        with daemon.link() as link:
            RemoteControl(link).stop()
        assert until(lambda: (now := told()) is not None and not now.armed)
        process.signal(signal.SIGTERM)
        assert process.wait() == 0
    assert not path.exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_the_motors_and_ends_the_daemon(
    daemon: Daemon, board: FakeBoard, number: signal.Signals
) -> None:
    with daemon.camera(), daemon.start() as process:
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD)
        process.signal(number)
        assert board.wait_for(0, 0)
        assert process.wait() == 0
    assert board.speeds == (0, 0)
    assert "Traceback" not in daemon.log.read_text()


def test_a_killed_workstation_changes_nothing_on_the_robot(
    daemon: Daemon, board: FakeBoard, tmp_path: Path
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        with workstation("telemetry", "--robot", daemon.address, log=tmp_path / "t.log") as watcher:
            assert until(lambda: watcher.output != "")
            watcher.signal(signal.SIGKILL)
            watcher.wait()
        assert board.wait_for(*FORWARD_BOARD)
        status = daemon.status()
        assert beats_on(daemon.status)
        assert daemon.status().missed_ticks == status.missed_ticks


def test_a_workstation_killed_while_it_drives_by_hand(
    daemon: Daemon, board: FakeBoard, tmp_path: Path
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        arguments = ("drive", "0.5", "0.5", "--for", "60", "--robot", daemon.address)
        with workstation(*arguments, log=tmp_path / "drive.log") as hand:
            assert board.wait_for(-148, 148)
            hand.signal(signal.SIGKILL)
            hand.wait()
        assert board.wait_for(0, 0)


def test_a_killed_camera_stops_the_robot_until_it_is_back(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.start():
        with daemon.camera() as camera:
            assert daemon.is_up()
            daemon.push(FORWARD)
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD)
            camera.signal(signal.SIGKILL)
            assert board.wait_for(0, 0)
        mark = len(board.commands)
        assert until(lambda: any("camera" in fault.kind for fault in daemon.status().faults))
        time.sleep(LONGER_THAN_FORGIVEN_S)
        assert all(command[1:] == (0, 0) for command in board.commands[mark:])
        with daemon.camera():
            assert until(lambda: not daemon.status().faults)
            assert beats_on(daemon.status)
            assert all(command[1:] == (0, 0) for command in board.commands[mark:])
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=15)


def test_a_frozen_camera_process_stops_the_robot(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.camera() as camera, daemon.start():
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD)
        camera.freeze()
        assert board.wait_for(0, 0)
        camera.signal(signal.SIGCONT)
        assert board.wait_for(*FORWARD_BOARD, timeout_s=15)


def test_a_killed_daemon_finds_the_motors_running_and_stops_them_at_its_next_start(
    daemon: Daemon, board: FakeBoard
) -> None:
    with daemon.camera():
        with daemon.start() as process:
            assert daemon.is_up()
            daemon.push(FORWARD)
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD)
            process.signal(signal.SIGKILL)
            process.wait()
        assert board.speeds == FORWARD_BOARD  # stock firmware: nothing stops it by itself
        mark = len(board.commands)
        daemon.log.write_text("")
        with daemon.start():
            assert daemon.is_up()
            assert board.commands[mark][1:] == (0, 0)
            # It starts idle, and the model it had is still the active one.
            assert board.speeds == (0, 0)
            assert daemon.status().active_model.name == "constant"


def test_stop_motors_is_what_systemd_runs_after_a_crash(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.camera(), daemon.start() as process:
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD)
        process.signal(signal.SIGKILL)
        process.wait()
    command = [PROGRAMS.format("mbot-agent"), "stop-motors", "--config", str(daemon.config)]
    assert ran(*command).returncode == 0
    assert board.speeds == (0, 0)


def test_a_board_that_vanishes_and_comes_back_stands_still_first(tmp_path: Path) -> None:
    port = tmp_path / "board"
    daemon = Daemon(tmp_path, str(port))
    with FakeBoard() as first, FakeBoard() as second, daemon.camera(), daemon.start():
        port.symlink_to(first.path)
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        assert first.wait_for(*FORWARD_BOARD, timeout_s=10)
        port.unlink()
        first.unplug()
        assert until(lambda: any("board" in fault.kind for fault in daemon.status().faults))
        port.symlink_to(second.path)
        assert second.wait_for(*FORWARD_BOARD, timeout_s=10)
        assert second.commands[0][1:] == (0, 0)


def test_commands_for_others_or_from_another_time_are_refused(
    daemon: Daemon, board: FakeBoard
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(FORWARD)
        assert until(daemon.is_ready)
        with daemon.link() as link:
            status = link.status()
            good = Command(
                schema_version=SCHEMA_VERSION,
                robot_id=status.robot_id,
                session_id=status.session_id,
                expires_monotonic_ns=status.now_monotonic_ns + 10**9,
                run=Run(),
            )
            for changes, words in (
                ({"robot_id": "mbot-9"}, "for robot 'mbot-9'"),
                ({"session_id": 7}, "before the robot's last start"),
                ({"expires_monotonic_ns": 1}, "expired"),
                ({"schema_version": 99}, "speaks schema 99"),
            ):
                bad = Command()
                bad.CopyFrom(good)
                for name, value in changes.items():
                    setattr(bad, name, value)
                reply = link.query(COMMAND, bad, CommandReply)
                assert not reply.accepted
                assert words in reply.reason
            assert beats_on(link.status, 1)
            assert not board.moved
            late_stop = Command(
                schema_version=SCHEMA_VERSION, robot_id=status.robot_id, stop=Stop()
            )
            assert link.query(COMMAND, late_stop, CommandReply).accepted


def test_malformed_queries_get_a_reason_and_the_daemon_lives(daemon: Daemon) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        with daemon.link() as link:
            send_nonsense(link)


def test_status_tells_how_the_motors_are_driven(daemon: Daemon) -> None:
    """So a workstation can say that the robot has another calibration than its own."""
    text = daemon.config.read_text()
    daemon.config.write_text(f"{text}\n[motors.right]\ntrim = 0.9\ndead_band = 30\n")
    with daemon.start():
        assert daemon.is_up()
        status = daemon.status()
    assert status.left_motor == MotorMap(reversed=True, trim=1.0, dead_band=40)
    assert status.right_motor == MotorMap(reversed=False, trim=0.9, dead_band=30)


def send_nonsense(link: RobotLink) -> None:
    session = link._open_session()  # pyright: ignore[reportPrivateUsage]
    for topic in (COMMAND, STATUS):
        for payload in (b"", b"\xff" * 40, os.urandom(200)):
            list(session.get(topic.key(link.robot_id), payload=payload, timeout=2.0))
    list(session.get("mbot/*/models/push/begin", payload=b"\x00\x01", timeout=2.0))
    assert link.status().robot_id == link.robot_id


def test_the_watchdog_is_fed_by_finished_ticks(daemon: Daemon, tmp_path: Path) -> None:
    address = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(address))
        manager.settimeout(15)
        with daemon.camera(), daemon.start(environment={"NOTIFY_SOCKET": str(address)}) as process:
            first = manager.recv(4096).decode()
            assert first == "READY=1"
            assert "WATCHDOG=1" in manager.recv(4096).decode()
            process.signal(signal.SIGTERM)
            process.wait()
        heard: list[str] = []
        manager.settimeout(0.1)
        try:
            while True:
                heard.append(manager.recv(4096).decode())
        except TimeoutError:
            pass
    assert heard[-1] == "STOPPING=1"


def run_agent(*arguments: str) -> subprocess.CompletedProcess[str]:
    return ran(PROGRAMS.format("mbot-agent"), *arguments)


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (None, 2, "no configuration at"),
        ("robot_id =", 2, "not valid TOML"),
        (
            'robot_id = "a"\n[board]\nprot = "x"',
            2,
            "board.prot is unknown (line 3); did you mean port?",
        ),
    ],
)
def test_a_bad_configuration_ends_with_one_line(
    tmp_path: Path, text: str | None, code: int, words: str
) -> None:
    path = tmp_path / "robot.toml"
    if text is not None:
        path.write_text(text)
    done = run_agent("run", "--config", str(path))
    assert done.returncode == code
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_second_daemon_on_the_same_endpoint_ends_with_one_line(
    daemon: Daemon, tmp_path: Path
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        done = run_agent("run", "--config", str(daemon.config))
        assert done.returncode == 4
        assert "is taken by mbot-agent (process" in done.stderr.strip().splitlines()[-1]
        checked = run_agent("check", "--config", str(daemon.config)).stdout
        (network,) = (line for line in checked.splitlines() if line.split()[1] == "network")
        assert network.startswith("ok")
        assert network.endswith("as the daemon that runs does")


def test_check_names_what_is_missing(tmp_path: Path) -> None:
    daemon = Daemon(tmp_path, "/dev/no-board")
    done = run_agent("check", "--config", str(daemon.config))
    assert done.returncode == 1
    lines = {line.split()[1]: line for line in done.stdout.splitlines()}
    assert lines["camera"].startswith("failed")
    assert "cannot open the camera" in lines["camera"]
    assert lines["board"].startswith("failed")
    assert "is it plugged in" in lines["board"]
    assert lines["model"].startswith("warning")
    assert lines["disk"].startswith("ok")


def test_check_is_content_with_a_whole_robot(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.camera() as camera:
        assert isinstance(camera, Process)
        time.sleep(1.0)
        done = run_agent("check", "--json", "--config", str(daemon.config))
    assert done.returncode == 0, done.stdout
    assert '"subject": "camera", "verdict": "ok"' in done.stdout
    assert not board.moved


def test_refusals_reach_the_workstation(daemon: Daemon) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        with daemon.link() as link, pytest.raises(RefusedError, match="no previous model"):
            activate(link, lambda _: daemon.key)
