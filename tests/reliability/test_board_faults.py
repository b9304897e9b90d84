"""Rows of the fault table: unplugged, partial write, board reset, wrong port and second process."""

import os
import pty
import signal
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import serial

from mbot_agent.board.mcore import mcore_session
from mbot_agent.board.motors import Motors
from mbot_agent.configuration import BoardSettings
from mbot_protocol.drive.mcore import STOP, VERSION_REQUEST, Joystick
from mbot_protocol.drive.wheel_command import WheelCommand

from ..end_to_end.processes import Daemon, beats_on, until
from ..promised import promised
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .effort import within
from .motion import FORWARD_BOARD, driven_since, drives_again, driving

Record = Callable[[str, object], None]

BACKWARD, BACKWARD_BOARD = constant_model(-0.6, -0.6), (169, -169)
FULL_SPEED = Joystick(-255, 255)

BOOT_S = 0.7
"""A real board is silent for 2.6 to 3.5 s; what counts is that nothing is driven meanwhile."""


def for_10_s() -> WheelCommand:
    return WheelCommand(FULL_SPEED.duties, time.monotonic_ns() + 10**10)


@pytest.mark.timeout(300)
def test_an_unplugged_board_is_noticed(tmp_path: Path, record_property: Record) -> None:
    port = tmp_path / "board"
    daemon = Daemon(tmp_path, str(port))
    board = FakeBoard().__enter__()
    port.symlink_to(board.path)
    with daemon.camera(), driving(daemon, board, daemon.start()), daemon.link() as link:

        def noticed_ms() -> float:
            nonlocal board
            port.unlink()
            unplugged_s = time.monotonic()
            board.unplug()

            def is_noticed() -> bool:
                return any(fault.kind == "board-lost" for fault in link.status().faults)

            assert until(is_noticed)
            found_ms = (time.monotonic() - unplugged_s) * 1000
            board = FakeBoard().__enter__()
            port.symlink_to(board.path)
            assert until(lambda: not daemon.status().faults)
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=15)
            assert board.commands[0][1:] == (0, 0)
            return found_ms

        found = within(promised("unplugged-noticed"), noticed_ms)
    record_property("noticed ms", round(max(found)))
    board.unplug()


@pytest.mark.parametrize("sent", range(1, 10))
def test_a_torn_write_ends_in_a_stop(
    board: FakeBoard, sent: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The port takes some bytes of a drive frame and no more, which times out."""
    whole_write = serial.Serial.write
    tear = threading.Event()

    def write(self: serial.Serial, data: bytes) -> int | None:
        if not (tear.is_set() and data == FULL_SPEED.to_bytes()):
            return whole_write(self, data)
        tear.clear()
        whole_write(self, data[:sent])
        raise serial.SerialTimeoutException("Write timeout")

    with Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(for_10_s())
        assert board.wait_for(FULL_SPEED.m1, FULL_SPEED.m2)
        monkeypatch.setattr(serial.Serial, "write", write)
        tear.set()
        mark = len(board.received)
        assert until(lambda: STOP.to_bytes() in bytes(board.received[mark:]))
        assert until(lambda: motors.fault is None)
        assert board.wait_for(0, 0)
        assert motors.stands(1.0), "no command is in force any more"
        assert board.speeds == (0, 0)
        motors.drive(for_10_s())
        assert board.wait_for(FULL_SPEED.m1, FULL_SPEED.m2)


@pytest.mark.timeout(300)
def test_a_board_that_was_reset_is_not_driven_before_it_has_answered(
    daemon: Daemon, board: FakeBoard, record_property: Record
) -> None:
    with daemon.camera(), driving(daemon, board, daemon.start()):

        def frames() -> float:
            mark = len(board.received)
            board.mute = True
            board.reset()
            time.sleep(BOOT_S)
            booting = bytes(board.received[mark:])
            assert VERSION_REQUEST in booting
            back_s = time.monotonic()
            board.mute = False
            assert until(lambda: not daemon.status().faults)
            assert beats_on(daemon.status, 1)
            assert not driven_since(board, back_s), "a reset disarms"
            assert "reset" in daemon.status().last_stop.why
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=15)
            commands = [command for command in board.commands if command[0] >= back_s]
            assert commands[0][1:] == (0, 0)
            return booting.count(Joystick(*FORWARD_BOARD).to_bytes())

        # One may be on its way while the board's word of its reset comes in; it is booting then.
        found = within(promised("reset-driven"), frames)
    record_property("motor frames before the handshake", max(found))


@contextmanager
def device(answer: Callable[[bytes], bytes]) -> Iterator[tuple[str, bytearray]]:
    """Something else on a serial port: its path, and what it has received."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    received = bytearray()
    closing = threading.Event()

    def run() -> None:
        os.set_blocking(master, False)
        while not closing.wait(0.005):
            try:
                data = os.read(master, 4096)
            except BlockingIOError:
                data = b""
            received.extend(data)
            if reply := answer(data):
                os.write(master, reply)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield os.ttyname(slave), received
    finally:
        closing.set()
        thread.join(2)
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(
    "answer",
    [
        lambda data: b"",
        lambda data: data,
        lambda data: b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n",
        lambda data: b"\xff\x55\r\n" if data else b"",
        lambda data: os.urandom(20),
    ],
    ids=["silent", "echo", "gps", "only acknowledges", "noise"],
)
def test_a_wrong_device_never_gets_a_drive_frame(
    answer: Callable[[bytes], bytes], monkeypatch: pytest.MonkeyPatch, record_property: Record
) -> None:
    monkeypatch.setattr(mcore_session, "HANDSHAKE_TIMEOUT_S", 0.5)
    with device(answer) as (path, received):
        with Motors(BoardSettings(port=path, accept_no_deadman=True)) as motors:
            assert until(lambda: motors.fault is not None and "baud" in motors.fault.detail)
            motors.drive(for_10_s())
            asked = received.count(VERSION_REQUEST)
            # It is asked again meanwhile, over a port that was reopened.
            assert until(lambda: received.count(VERSION_REQUEST) >= asked + 2)
        frames = bytes(received).count(FULL_SPEED.to_bytes())
    record_property("motor frames", frames)
    assert frames == promised("wrong-device-driven")


def test_a_second_daemon_gets_no_say(
    daemon: Daemon, board: FakeBoard, tmp_path: Path, record_property: Record
) -> None:
    """With a network address of its own, told to drive, and with the board's only port."""
    (tmp_path / "second").mkdir()
    second = Daemon(tmp_path / "second", board.path)
    assert second.address != daemon.address
    with daemon.camera(), ExitStack() as first:
        process = first.enter_context(driving(daemon, board, daemon.start()))
        mark = len(board.commands)
        with second.camera(), second.start():
            assert second.is_up()
            second.push(BACKWARD)
            second.run()
            assert until(lambda: any(f.kind == "board-lost" for f in second.status().faults))
            assert beats_on(second.status)
            (fault,) = (fault for fault in second.status().faults if fault.kind == "board-lost")
            assert "in use by another process" in fault.detail
            speeds = [command[1:] for command in board.commands[mark:]]
            frames = speeds.count(BACKWARD_BOARD)
            record_property("motor frames", frames)
            assert frames == promised("wrong-device-driven")
            assert set(speeds) <= {FORWARD_BOARD, (0, 0)}
            # The first one drives on.
            assert board.wait_for(*FORWARD_BOARD)
            assert daemon.status().faults == []
            # Once it has ended, the second one may.
            process.signal(signal.SIGTERM)
            assert process.wait() == 0
            assert drives_again(second, board, BACKWARD_BOARD)


def test_a_reset_announced_right_behind_an_acknowledgement_counts() -> None:
    """Both lie in the buffer for a daemon that was kept from reading for a while."""
    acknowledgement, banner = b"\xff\x55\r\n", b"Version: 06.01.107\r\n"

    def answer(data: bytes) -> bytes:
        if VERSION_REQUEST in data:
            return b"\xff\x55\x00\x04\x0906.01.107\r\n"
        if FULL_SPEED.to_bytes() in data:
            return acknowledgement + banner
        return acknowledgement if data else b""

    with (
        device(answer) as (path, received),
        Motors(BoardSettings(port=path, accept_no_deadman=True)) as motors,
    ):
        assert until(lambda: motors.fault is None)
        motors.drive(for_10_s())
        assert until(lambda: bytes(received).count(VERSION_REQUEST) > 1, 3)
        assert bytes(received).count(FULL_SPEED.to_bytes()) == 1
