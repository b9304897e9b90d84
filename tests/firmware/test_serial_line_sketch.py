"""deploy/serial-line, compiled for an ATmega328P: in simulated time, then with the real session."""

import time
from pathlib import Path

import pytest

from mbot_agent.board.board_session import UnacknowledgedError
from mbot_agent.board.lines.line_session import LineSession
from mbot_agent.configuration import BoardSettings
from mbot_protocol.drive.wheel_command import Duties
from mbot_workstation.virtual.emulated.board_simulator import simulator_program

from ..ran import ran
from .conftest import CHECKOUT, HERE
from .frames import Event, rx
from .simulated_board import LiveBoard, Simulator

SKETCH = CHECKOUT / "deploy" / "serial-line" / "serial-line.ino"
NAME = b"serial-line 1 300ms\r\n"
LINE = b"D-120+080\n"
DRIVING = (-120, 80)
OFF = (0, 0)
INPUTS = 0b10011100
"""Of the driver, forward and backward, on port D."""


@pytest.fixture(scope="session")
def sketch(firmware_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Simulator:
    """Compiled as Arduino's IDE does, which puts its header in front."""
    program = tmp_path_factory.mktemp("sketch") / "serial-line.elf"
    flags = ("-mmcu=atmega328p", "-std=gnu++11", "-Os", "-Wall", "-Wextra", "-Werror")
    header = HERE / "arduino" / "Arduino.h"
    done = ran("avr-g++", *flags, "-include", header, "-x", "c++", SKETCH, "-o", program)
    assert done.returncode == 0, done.stderr
    return Simulator(simulator_program(), program)


def test_it_fits_on_a_page() -> None:
    assert len(SKETCH.read_text().splitlines()) <= 62


def test_it_drives_when_armed_and_echoes_what_it_obeys(sketch: Simulator) -> None:
    trace = sketch.run(rx(20, LINE), rx(40, b"A\n"), rx(60, LINE), rx(80, b"V\r\n"), end_ms=100)
    assert trace.replies(0, 40) == b"boot " + NAME
    assert trace.speeds_at(59) == OFF
    assert trace.replies(40) == b"A\r\n" + LINE[:-1] + b"\r\n" + NAME
    assert trace.speeds_at(100) == DRIVING
    assert trace.pins[-1].portd & INPUTS == 0b00010100  # left backward, right forward


def test_every_speed_is_a_duty_and_zero_is_off(sketch: Simulator) -> None:
    speeds = [(v, -v) for v in range(-255, 256, 15)] + [(255, 0), (0, -255), (1, -1)]
    events = [rx(60 + 8 * i, b"D%+04d%+04d\n" % pair) for i, pair in enumerate(speeds)]
    trace = sketch.run(rx(40, b"A\n"), *events, rx(900, b"S\n"), end_ms=920)
    for (ms, _, _), pair in zip(events, speeds, strict=True):
        assert trace.speeds_at(ms + 6) == pair
    assert trace.speeds_at(920) == OFF
    assert trace.pins[-1].portd & INPUTS == 0


def test_300_ms_of_silence_stop_it_until_it_is_armed_again(sketch: Simulator) -> None:
    events = [rx(40, b"A\n"), rx(60, LINE), rx(200, b"V\n"), rx(400, LINE), rx(440, b"S\n")]
    trace = sketch.run(*events, rx(460, LINE), rx(480, b"A\n"), rx(500, LINE), end_ms=520)
    assert trace.speeds_at(355) == DRIVING
    assert trace.speeds_at(365) == OFF, "asking for its name is no command to drive"
    assert trace.speeds_at(499) == OFF, "neither a command nor a stop arms"
    assert trace.speeds_at(520) == DRIVING
    assert trace.replies(400, 470) == b"S\r\n"


@pytest.mark.parametrize(
    "line",
    [
        *(LINE[:n] for n in range(1, 9)),  # torn at its end
        *(LINE[n:] for n in range(1, 9)),  # at its beginning
        *(LINE[:n] + LINE[n + 1 :] for n in range(9)),  # a byte lost
        *(LINE[:n] + LINE for n in range(1, 9)),  # two run together
        b"D-120+256\n", b"D-999+000\n", b"D 120+080\n", b"D-000+080\n", b"D-1 0+080\n",
        b"D-120+0800\n", b"d-120+080\n", b"AA\n", b"SA\n", b"\x00\n", b"A" * 300 + b"\n",
    ],
)  # fmt: skip
def test_what_is_no_whole_line_is_not_obeyed(sketch: Simulator, line: bytes) -> None:
    end = b"" if line.endswith(b"\n") else b"\n"
    trace = sketch.run(rx(40, b"A\n"), rx(60, b"D+050+050\n"), rx(80, line + end), end_ms=120)
    assert trace.speeds_at(120) == (50, 50)
    assert trace.replies(80) == b""
    late = 80 + len(line) / 10 + 10
    trace = sketch.run(rx(40, b"A\n"), rx(80, line), rx(late, b"\nS\n"), end_ms=late + 20)
    assert trace.replies(late) == b"S\r\n", "a stop is heard behind it"
    assert trace.speeds_since() == {OFF}


def test_a_reset_is_told_and_stands(sketch: Simulator) -> None:
    reset: Event = (100, "reset", b"")
    trace = sketch.run(rx(40, b"A\n"), rx(60, LINE), reset, rx(140, LINE), end_ms=200)
    assert trace.speeds_at(99) == DRIVING
    assert trace.replies(100) == b"boot " + NAME
    assert trace.speeds_since(110) == {OFF}


def test_the_daemons_session_drives_it_and_its_silence_stops_it(sketch: Simulator) -> None:
    with (
        LiveBoard(sketch) as board,
        LineSession.open(BoardSettings(port=board.port), None) as session,
    ):
        assert session.handshake(lambda: False)
        assert session.firmware.has_deadman
        session.arm()
        for _ in range(5):
            session.send(Duties(-120 / 255, 80 / 255))
            time.sleep(0.1)
        assert board.speeds == DRIVING
        assert board.wait_for(0, 0, timeout_s=5)
        with pytest.raises(UnacknowledgedError):
            session.send(Duties(1.0, 1.0))
        session.arm()
        session.send(Duties(1.0, 1.0))
        assert board.wait_for(255, 255)
        session._line.write(b"D-12")  # pyright: ignore[reportPrivateUsage]
        session.stop()
        assert board.wait_for(0, 0)
