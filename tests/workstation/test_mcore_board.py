import os
from pathlib import Path

import pytest
import serial

from mbot_protocol.drive.mcore import BAUD_RATE, STOP, VERSION_REQUEST, Joystick, stop_burst
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.virtual.mcore_board import McoreBoard

from ..until import until

DRIVE = Joystick(-200, 200)
LIMIT_S = 10


def opened(path: Path) -> serial.Serial:
    return serial.Serial(str(path), BAUD_RATE, timeout=LIMIT_S)


def test_a_serial_port_drives_and_asks() -> None:
    with McoreBoard() as board, opened(board.path) as port:
        port.write(DRIVE.to_bytes())
        assert port.read(4) == b"\xff\x55\r\n"
        assert board.state.motors == DRIVE
        port.write(VERSION_REQUEST)
        assert port.read(16) == b"\xff\x55\x00\x04\x0906.01.107\r\n"
        port.write(stop_burst())
        assert port.read(4) == b"\xff\x55\r\n"
        assert board.state.motors == STOP
        assert board.state.commands == 2


def test_the_link_leads_to_it_and_goes_with_it(tmp_path: Path) -> None:
    link = tmp_path / "board"
    link.symlink_to(tmp_path / "gone")
    with McoreBoard(link) as board, opened(link) as port:
        assert board.path == link
        port.write(DRIVE.to_bytes())
        assert port.read(4)
    assert not os.path.lexists(link)


def test_a_file_in_the_way_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "board"
    path.write_text("mine")
    with pytest.raises(ConfigurationError, match=r"board: there is a file.*--board"):
        McoreBoard(path)
    assert path.read_text() == "mine"


def test_it_goes_on_when_the_host_goes_and_comes_back() -> None:
    with McoreBoard() as board:
        for _ in range(3):
            with opened(board.path) as port:
                port.write(DRIVE.to_bytes())
                assert port.read(4)
        assert board.state.motors == DRIVE, "closing the port stops nothing"


def test_the_trace_misses_no_state_of_one_write() -> None:
    with McoreBoard() as board, opened(board.path) as port:
        port.write(DRIVE.to_bytes() + STOP.to_bytes())
        assert port.read(8)
        assert [state.motors for state in board.trace] == [STOP, DRIVE, STOP]
        times = [state.since_s for state in board.trace]
        assert times == sorted(times)


def test_a_host_that_never_reads_does_not_block_it() -> None:
    with McoreBoard() as board, opened(board.path) as port:
        for number in range(3000):
            port.write(Joystick(-(number % 250), 1).to_bytes())
        assert until(lambda: board.state.commands == 3000)
        port.write(STOP.to_bytes())
        assert until(lambda: board.state.motors == STOP)


def test_a_reset_stops_the_motors_and_says_so() -> None:
    with McoreBoard() as board, opened(board.path) as port:
        port.write(DRIVE.to_bytes())
        assert port.read(4)
        board.reset()
        assert port.read(20) == b"Version: 06.01.107\r\n"
        assert board.state.motors == STOP


def test_opening_resets_it_and_leaves_it_deaf_while_it_boots() -> None:
    with McoreBoard(boot_s=0.3) as board:
        for _ in range(2):
            with opened(board.path) as port:
                assert until(lambda: board.state.motors == STOP)
                port.write(DRIVE.to_bytes())
                assert port.read(20) == b"Version: 06.01.107\r\n"
                assert board.state.motors == STOP, "what came while it was deaf is lost"
                port.write(DRIVE.to_bytes())
                assert port.read(4) == b"\xff\x55\r\n"
            assert board.state.motors == DRIVE, "closing the port stops nothing"
            assert until(lambda: not board.connected)
