"""The emulated board as a serial port: the compiled firmware answers and turns the motors."""

import os
import signal
import time
from pathlib import Path

import pytest
import serial

from mbot_protocol.drive.mcore import ARM_REQUEST, BAUD_RATE, STOP, VERSION_REQUEST, Joystick
from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_workstation.virtual.emulated.emulated_board import EmulatedBoard

from ..until import until
from .frames import ACKNOWLEDGED, VERSION_REPLY
from .simulated_board import emulators_of

DRIVE = Joystick(-200, 100)
STOCK_VERSION_REPLY = b"\xff\x55\x00\x04\x0906.01.107\r\n"
STOCK_BANNER = b"Version: 06.01.107\r\n"
LIMIT_S = 10


def opened(path: Path) -> serial.Serial:
    return serial.Serial(str(path), BAUD_RATE, timeout=LIMIT_S)


def answers(port: serial.Serial, frame: bytes, expected: bytes) -> bool:
    """Whether the answer comes; the rest of a banner may come before it."""
    port.write(frame)
    return port.read_until(expected).endswith(expected)


def is_up(port: serial.Serial, version: bytes = VERSION_REPLY) -> bool:
    """What is sent in the first 0.1 ms is lost, as on any board."""
    port.timeout = 0.2
    is_there = until(lambda: answers(port, VERSION_REQUEST, version))
    port.timeout = LIMIT_S
    return is_there


@pytest.mark.parametrize("name", ["mbot-deadman.elf", "mbot-deadman.hex"])
def test_a_serial_port_asks_and_drives_until_it_is_silent(firmware_folder: Path, name: str) -> None:
    with EmulatedBoard(firmware_folder / name) as board, opened(board.path) as port:
        assert is_up(port)
        assert answers(port, ARM_REQUEST, ACKNOWLEDGED)
        assert answers(port, DRIVE.to_bytes(), ACKNOWLEDGED)
        assert until(lambda: board.state.commands == 2)
        assert until(lambda: board.state.motors == STOP)
        assert 299_000 <= board.changed_us - board.heard_us <= 302_000
        assert [state.motors for state in board.trace] == [STOP, DRIVE, STOP]
        assert 299 <= board.state.silent_ms <= 302
        assert answers(port, ARM_REQUEST, ACKNOWLEDGED)
        assert answers(port, DRIVE.to_bytes(), ACKNOWLEDGED)
        assert answers(port, STOP.to_bytes(), ACKNOWLEDGED)
        assert until(lambda: board.state.motors == STOP)
        assert board.state.silent_ms == 0, "this time it was told"
    assert board.state.motors == STOP
    assert not emulators_of(os.getpid())


def test_a_firmware_without_a_switch_drives_on_at_full_speed(drives_on: Path) -> None:
    full = Joystick(255, -255)
    with EmulatedBoard(drives_on) as board:
        with opened(board.path) as port:
            assert is_up(port, STOCK_VERSION_REPLY)
            assert answers(port, full.to_bytes(), ACKNOWLEDGED), "button or receiver disturb it"
            assert until(lambda: board.state.motors == full)
        assert not until(lambda: board.state.motors != full, 1.0)


def test_opening_resets_it_as_often_as_it_happens(drives_on: Path) -> None:
    with EmulatedBoard(drives_on, boot_s=0.3) as board:
        for _ in range(2):
            with opened(board.path) as port:
                assert until(lambda: board.state.motors == STOP)
                assert answers(port, DRIVE.to_bytes(), STOCK_BANNER)
                assert board.state.motors == STOP, "what came while it was deaf is lost"
                assert answers(port, DRIVE.to_bytes(), ACKNOWLEDGED)
                assert until(lambda: board.state.motors == DRIVE)
            time.sleep(0.2)  # it looks every 0.5 ms whether anybody is still there


def test_the_link_leads_to_it_and_goes_with_it(firmware_folder: Path, tmp_path: Path) -> None:
    link = tmp_path / "board"
    with EmulatedBoard(firmware_folder / "mbot-deadman.elf", link) as board:
        assert board.path == link
        with opened(link) as port:
            assert is_up(port)
    assert not os.path.lexists(link)


def test_a_file_in_the_links_way_is_left_alone(firmware_folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "board"
    path.write_text("mine")
    with (
        pytest.raises(ConfigurationError, match=r"board: there is a file.*--board"),
        EmulatedBoard(firmware_folder / "mbot-deadman.elf", path),
    ):
        pass
    assert path.read_text() == "mine"
    assert not emulators_of(os.getpid())


def test_a_torn_firmware_is_one_line(firmware_folder: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.elf"
    torn.write_bytes((firmware_folder / "mbot-deadman.elf").read_bytes()[:200])
    with pytest.raises(MbotError, match="board has ended: cannot read") as told:
        EmulatedBoard(torn).__enter__()
    assert "\n" not in str(told.value)


def test_an_emulator_that_dies_is_noticed(firmware_folder: Path) -> None:
    with EmulatedBoard(firmware_folder / "mbot-deadman.elf") as board:
        assert board.state.motors == STOP
        (pid,) = emulators_of(os.getpid())
        os.kill(pid, signal.SIGKILL)

        def is_noticed() -> bool:
            try:
                return board.state.motors != STOP
            except MbotError as error:
                return "the emulated board has ended" in str(error)

        assert until(is_noticed)
