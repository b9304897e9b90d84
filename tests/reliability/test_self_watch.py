"""Rows of the fault table: the daemon watches itself. Dead and hung threads, a log nobody reads."""

import fcntl
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from mbot_agent.process.termination import THREAD_DIED
from mbot_protocol.errors import MbotError
from mbot_protocol.v1.messages_pb2 import Command, CommandReply
from mbot_protocol.wire.keys import COMMAND, STOP
from mbot_workstation.fleet.link.remote_control import NotStandingError, RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink

from ..end_to_end.processes import PROGRAMS, ROBOT_ID, Daemon, Process, until
from ..promised import promised
from ..robot.fake_board import FakeBoard
from .effort import REPEATS, TRIES, second_worst
from .motion import FORWARD, FORWARD_BOARD, driven_since, driving, script

Record = Callable[[str, object], None]


def ask(daemon: Daemon, thread: str) -> None:
    """Have a thread at work that waits for a question."""
    topic = {"stop": STOP, "confirm": STOP, "command": COMMAND}.get(thread)
    if topic is not None:
        with suppress(MbotError), RobotLink(daemon.address, ROBOT_ID) as link:
            link.query(topic, Command(schema_version=1), CommandReply, 0.3)


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "thread", ["motors", "camera", "telemetry", "stop", "confirm", "command", "main"]
)
def test_an_exception_that_ends_any_thread_ends_the_process_with_the_motors_off(
    daemon: Daemon, board: FakeBoard, thread: str, record_property: Record
) -> None:
    ailment = daemon.directory / "ailment"
    ended_ms: list[float] = []
    with daemon.camera():
        for _ in range(REPEATS):
            ailment.unlink(missing_ok=True)
            daemon.log.write_text("")
            with driving(daemon, board, script(daemon, "ailing_daemon.py")) as process:
                ailment.write_text(f"{thread} dies")
                died_s = time.monotonic()
                ask(daemon, thread)
                assert board.wait_for(0, 0)
                assert process.wait() == THREAD_DIED
                ended_ms.append((time.monotonic() - died_s) * 1000)
                assert board.speeds == (0, 0)
    record_property("ended ms", round(max(ended_ms)))
    # A tick or a heartbeat until the thread is at it again, and 500 ms for the stop's confirmation.
    assert second_worst(ended_ms) < promised("dead-thread-ended") * 1000


@contextmanager
def service_manager(directory: Path) -> Iterator[tuple[dict[str, str], Callable[[], list[str]]]]:
    """systemd's end of sd_notify: the environment for the daemon, and what came since asked."""
    path = directory / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notified:
        notified.bind(str(path))
        notified.setblocking(False)

        def heard() -> list[str]:
            found: list[str] = []
            try:
                while True:
                    found.append(notified.recv(4096).decode())
            except BlockingIOError:
                return found

        yield {"NOTIFY_SOCKET": str(path)}, heard


@pytest.mark.timeout(120)
@pytest.mark.parametrize("thread", ["motors", "stop", "confirm", "command"])
def test_a_thread_that_hangs_starves_the_watchdog(
    daemon: Daemon, board: FakeBoard, thread: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with service_manager(daemon.directory) as (environment, heard), daemon.camera():
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        with driving(daemon, board, script(daemon, "ailing_daemon.py")) as process:
            heard()
            assert until(lambda: any("WATCHDOG=1" in line for line in heard()), 2)
            (daemon.directory / "ailment").write_text(f"{thread} hangs")
            ask(daemon, thread)
            assert until(lambda: "no progress" in daemon.log.read_text(), 5)
            heard()
            lines: list[str] = []

            def beats() -> int:
                lines.extend(heard())
                return len(lines)

            assert until(lambda: beats() >= 3), "the loop goes on"
            assert not any("WATCHDOG=1" in line for line in lines)
            process.signal(signal.SIGKILL)


@pytest.mark.timeout(300)
@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT, signal.SIGINT])
def test_every_signal_that_ends_it_stops_the_motors_first(
    daemon: Daemon, board: FakeBoard, number: signal.Signals, record_property: Record
) -> None:
    frame_ms: list[float] = []
    with daemon.camera():
        for _ in range(max(TRIES, REPEATS)):
            daemon.log.write_text("")
            with driving(daemon, board, daemon.start()) as process:
                sent_s = time.monotonic()
                process.signal(number)
                assert board.wait_for(0, 0)
                assert process.wait() == 0
            stopped_s = next(at for at, m1, _ in board.commands if at >= sent_s and m1 == 0)
            assert not driven_since(board, stopped_s)
            frame_ms.append((stopped_s - sent_s) * 1000)
    record_property("frame ms", round(max(frame_ms), 1))
    assert second_worst(frame_ms) < promised("stop-frame-out")


class Unread:
    """A daemon whose stderr is a pipe that nobody reads, and that is full."""

    def __init__(self, daemon: Daemon) -> None:
        self._reader, writer = os.pipe()
        os.set_blocking(writer, False)
        with suppress(BlockingIOError):
            while True:
                os.write(writer, bytes(4096))
        os.set_blocking(writer, True)
        command = [PROGRAMS.format("mbot-agent"), "run", "--config", str(daemon.config)]
        self.process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=writer, stdin=subprocess.DEVNULL
        )
        os.close(writer)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._reader)


@pytest.mark.timeout(120)
def test_a_log_that_nobody_reads_holds_up_no_stop(
    daemon: Daemon, board: FakeBoard, record_property: Record
) -> None:
    unread = Unread(daemon)
    try:
        with daemon.camera():
            assert until(lambda: answers(daemon), 20)
            daemon.push(FORWARD)
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=15)
            with daemon.link() as link:
                stop_ms = [timed_ms(RemoteControl(link).stop) for _ in range(10)]
                assert board.speeds == (0, 0)
                daemon.run()
                assert board.wait_for(*FORWARD_BOARD, timeout_s=15)
                board.mute = True  # the board is lost, and that is worth a line
                lost_ms = [timed_ms(lambda: link_stop(link)) for _ in range(3)]
            board.mute = False
            sent_s = time.monotonic()
            unread.process.send_signal(signal.SIGTERM)
            assert unread.process.wait(5) == 0
            record_property("ended s", round(time.monotonic() - sent_s, 2))
    finally:
        unread.close()
    record_property("STOP ms", round(max(stop_ms), 1))
    record_property("STOP, board lost, ms", round(max(lost_ms), 1))
    assert second_worst(stop_ms) < promised("stop-log-unread")
    assert second_worst(lost_ms) < promised("stop-board-lost")  # 80 ms are waited for the board


def answers(daemon: Daemon) -> bool:
    try:
        return daemon.status() is not None
    except MbotError:
        return False


def timed_ms(act: Callable[[], object]) -> float:
    began_s = time.monotonic()
    act()
    return (time.monotonic() - began_s) * 1000


def link_stop(link: object) -> None:
    """One STOP and its reply, whatever it says of the board."""
    assert isinstance(link, RobotLink)
    reply = link.query(STOP, Command(schema_version=1), CommandReply, 1.0)
    assert reply.accepted
    assert not reply.standing


@pytest.mark.timeout(120)
def test_a_stop_is_not_confirmed_for_a_lost_board(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.camera(), driving(daemon, board, daemon.start()), daemon.link() as link:
        board.mute = True
        with pytest.raises(NotStandingError, match="not confirmed"):
            RemoteControl(link).stop()
        command = ["stop", "--robot", daemon.address]
        with Process(PROGRAMS.format("workstation"), *command, log=daemon.directory / "s") as stop:
            assert stop.wait() == 1
            assert "not confirmed that it has stopped" in stop.output


def open_as_nobody(path: str) -> str:
    """What a plain open() by a process without privileges says."""
    program = (
        "import os,sys\n"
        "try: os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('opened')\n"
        "except OSError as error: print(os.strerror(error.errno))"
    )
    done = subprocess.run(
        ["/usr/bin/env", "python3", "-c", program, path],
        capture_output=True,
        text=True,
        check=True,
        user=65534,
        group=65534,
        extra_groups=[],
    )
    return done.stdout.strip()


@pytest.mark.skipif(os.geteuid() != 0, reason="gives up privileges, which takes some")
def test_the_port_is_exclusive_in_fact(board: FakeBoard, monkeypatch: pytest.MonkeyPatch) -> None:
    from mbot_agent.board import serial_port

    monkeypatch.setattr(serial_port, "PSEUDO_TERMINALS", "/nowhere")
    os.chmod(board.path, 0o666)  # noqa: PTH101
    assert open_as_nobody(board.path) == "opened"
    with serial_port.open_port(board.path, 115_200) as port:
        assert open_as_nobody(board.path) == "Device or resource busy"
        fcntl.ioctl(port.fileno(), 0x540D)  # TIOCNXCL: the test's own end stays open
    assert open_as_nobody(board.path) == "opened"
