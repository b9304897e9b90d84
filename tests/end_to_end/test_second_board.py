"""The real daemon drives a board of another kind, of which nothing else in it knows."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_protocol.v1.messages_pb2 import State
from mbot_workstation.fleet.link.remote_control import RemoteControl

from ..ran import ran
from ..robot.line_board import NAME, LineBoard
from ..robot.tiny_models import constant_model
from .processes import PROGRAMS, Daemon, until

DRIVES = "D-169+083"
"""0.6 and 0.2 above the dead band. The left motor is the reversed one."""


@pytest.fixture
def line_board() -> Iterator[LineBoard]:
    with LineBoard() as board:
        yield board


def configure(daemon: Daemon, text: str) -> None:
    usual = "accept_no_deadman = true"
    assert usual in daemon.config.read_text()
    daemon.config.write_text(daemon.config.read_text().replace(usual, text))


def command(daemon: Daemon, action: str) -> tuple[str, ...]:
    return PROGRAMS.format("mbot-agent"), action, "--config", str(daemon.config)


@pytest.fixture
def daemon(tmp_path: Path, line_board: LineBoard) -> Daemon:
    made = Daemon(tmp_path, line_board.path)
    configure(made, 'kind = "serial-line"')
    return made


def test_a_board_of_another_kind_is_driven_and_stopped(
    daemon: Daemon, line_board: LineBoard
) -> None:
    with daemon.camera() as camera, daemon.start() as process:
        assert daemon.is_up()
        assert line_board.lines[:3] == ["S", "V", "S"], "stopped before anything else"
        daemon.push(constant_model(0.6, 0.2))
        assert until(daemon.is_ready)
        assert daemon.status().board_version == NAME
        assert daemon.status().board_has_deadman
        assert set(line_board.lines[3:]) <= {"S", "D+000+000"}
        daemon.run()
        assert until(lambda: line_board.last == DRIVES)
        with daemon.link() as link:
            RemoteControl(link).stop()
        assert line_board.stands, "the reply says that it stands"
        daemon.run()
        assert until(lambda: line_board.last == DRIVES)
        camera.freeze()  # what its frames allow is over: the guard
        assert until(lambda: line_board.last != DRIVES)
        camera.signal(signal.SIGCONT)
        assert until(lambda: daemon.status().state == State.STATE_RUNNING)
        assert until(lambda: line_board.last == DRIVES)
        process.freeze()
        process.signal(signal.SIGKILL)
    assert line_board.last == DRIVES, "nobody was left to stop it"
    done = ran(*command(daemon, "stop-motors"))
    assert done.returncode == 0, done.stderr
    assert line_board.lines[-3:] == ["V", "S", "S"]


def test_its_reset_disarms_and_its_silence_is_a_lost_board(
    daemon: Daemon, line_board: LineBoard
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(constant_model(0.6, 0.2))
        assert until(daemon.is_ready)
        daemon.run()
        assert until(lambda: line_board.last == DRIVES)
        line_board.reset()
        assert until(lambda: daemon.status().state == State.STATE_STOPPED)
        assert "the board was reset" in daemon.status().last_stop.why
        line_board.mute = True
        assert until(lambda: [one.kind for one in daemon.status().faults] == ["board-lost"])
        line_board.mute = False
        assert until(daemon.is_ready)
        assert line_board.stands


def test_check_looks_at_it_and_an_unknown_kind_is_named(
    daemon: Daemon, line_board: LineBoard
) -> None:
    done = ran(*command(daemon, "check"))
    assert f"ok       board    {line_board.path}: firmware {NAME}" in done.stdout
    daemon.config.write_text(daemon.config.read_text().replace("serial-line", "linse"))
    done = ran(*command(daemon, "run"))
    assert done.returncode == 2
    assert "board.kind is 'linse', expected one of mcore, serial-line, gpio" in done.stderr


MOCK_PINS = {"GPIOZERO_PIN_FACTORY": "mock", "GPIOZERO_MOCK_PIN_CLASS": "mockpwmpin"}


def test_a_driver_on_the_pins_has_to_be_accepted_and_is_stopped_by_whoever_comes_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in MOCK_PINS.items():
        monkeypatch.setenv(name, value)
    daemon = Daemon(tmp_path, "auto")
    configure(daemon, 'kind = "gpio"')
    done = ran(*command(daemon, "check"))
    assert "failed   board    GPIO 17, 27, 22, 23: firmware gpiozero 2" in done.stdout
    assert "keeps its last command for ever" in done.stdout
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        assert until(lambda: "board-no-deadman" in [one.kind for one in daemon.status().faults])
    daemon.log.unlink()
    daemon.config.write_text(
        daemon.config.read_text().replace('"gpio"', '"gpio"\naccept_no_deadman = true')
    )
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(constant_model(0.6, 0.2))
        assert until(daemon.is_ready)
        daemon.run()
        assert until(lambda: daemon.status().state == State.STATE_RUNNING)
    daemon.config.write_text(daemon.config.read_text().replace("robot_id", "robot-id"))
    done = ran(*command(daemon, "stop-motors"))
    assert done.returncode == 0, done.stderr
    assert "motors stopped (GPIO 17, 27, 22, 23, gpiozero 2" in done.stderr
