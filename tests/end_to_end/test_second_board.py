"""The real daemon drives another kind of board, of which nothing else in it knows."""

import os
import pty
import select
import signal
import sys
import threading
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Self

import pytest

from mbot_agent.board.board_session import BoardSession
from mbot_agent.configuration import BoardSettings
from mbot_protocol.v1.messages_pb2 import State
from mbot_workstation.fleet.link.remote_control import RemoteControl

from ..ran import ran
from ..robot.tiny_models import constant_model
from .line_board_daemon import LineSession
from .processes import HERE, Daemon, Process, until

DRIVES = "D -0.6627 0.3255"
"""0.6 and 0.2 above the dead band. The left motor is the reversed one."""
STANDS = "D 0.0000 0.0000"


class LineBoard:
    """The far end: obeys lines, and keeps them."""

    def __init__(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self.lines: list[str] = []
        self.mute = self._closing = False
        self._thread = threading.Thread(target=self._obey, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        self._thread.join(2)
        os.close(self._master)
        os.close(self._slave)

    @property
    def last(self) -> str:
        return self.lines[-1] if self.lines else ""

    def say(self, line: str) -> None:
        os.write(self._master, f"{line}\n".encode())

    def _obey(self) -> None:
        heard = b""
        while not self._closing:
            if not select.select([self._master], [], [], 0.02)[0]:
                continue
            *whole, heard = (heard + os.read(self._master, 4096)).split(b"\n")
            for line in (one.decode() for one in whole if one and not self.mute):
                self.lines.append(line)
                self.say("line-board 1" if line == "V" else "ok")


@pytest.fixture
def line_board() -> Iterator[LineBoard]:
    with LineBoard() as board:
        yield board


class LineDaemon(Daemon):
    def __init__(self, directory: Path, board: LineBoard) -> None:
        super().__init__(directory, board.path)
        usual = "accept_no_deadman = true"
        assert usual in self.config.read_text()
        self.config.write_text(self.config.read_text().replace(usual, 'kind = "lines"'))

    def command(self, action: str) -> tuple[str, ...]:
        program = str(HERE / "line_board_daemon.py")
        return sys.executable, program, action, "--config", str(self.config)

    def start(self, *, environment: dict[str, str] | None = None) -> Process:
        return Process(*self.command("run"), log=self.log, environment=environment)


@pytest.fixture
def daemon(tmp_path: Path, line_board: LineBoard) -> LineDaemon:
    return LineDaemon(tmp_path, line_board)


def test_a_board_of_another_kind_is_driven_and_stopped(
    daemon: LineDaemon, line_board: LineBoard
) -> None:
    with daemon.camera() as camera, daemon.start() as process:
        assert daemon.is_up()
        assert line_board.lines[:3] == ["V", "S", "S"], "stopped before anything else"
        daemon.push(constant_model(0.6, 0.2))
        assert until(daemon.is_ready)
        assert daemon.status().board_version == "line-board 1"
        assert daemon.status().board_has_deadman
        assert set(line_board.lines[3:]) <= {"S", STANDS}
        daemon.run()
        assert until(lambda: line_board.last == DRIVES)
        with daemon.link() as link:
            RemoteControl(link).stop()
        assert line_board.last in ("S", STANDS), "the reply says that it stands"
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
    done = ran(*daemon.command("stop-motors"))
    assert done.returncode == 0, done.stderr
    assert line_board.lines[-2:] == ["S", "S"]


def test_its_reset_disarms_and_its_silence_is_a_lost_board(
    daemon: LineDaemon, line_board: LineBoard
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(constant_model(0.6, 0.2))
        assert until(daemon.is_ready)
        daemon.run()
        assert until(lambda: line_board.last == DRIVES)
        line_board.say("boot")
        assert until(lambda: daemon.status().state == State.STATE_STOPPED)
        assert "the board was reset" in daemon.status().last_stop.why
        line_board.mute = True
        assert until(lambda: [one.kind for one in daemon.status().faults] == ["board-lost"])
        line_board.mute = False
        assert until(daemon.is_ready)
        assert line_board.last in ("S", STANDS)


def test_check_looks_at_it_and_an_unknown_kind_is_named(
    daemon: LineDaemon, line_board: LineBoard
) -> None:
    done = ran(*daemon.command("check"))
    assert f"ok       board    {line_board.path}: firmware line-board 1" in done.stdout
    daemon.config.write_text(daemon.config.read_text().replace('"lines"', '"linse"'))
    done = ran(*daemon.command("run"))
    assert done.returncode == 2
    assert "board.kind is 'linse', expected one of mcore, lines" in done.stderr


def test_it_is_what_every_kind_must_be(line_board: LineBoard) -> None:
    reader, writer = os.pipe()
    session: BoardSession = LineSession(BoardSettings(port=line_board.path), reader)
    with session:
        assert session.handshake(lambda: False)
        os.write(writer, b"x")
        session.wait(60.0)
    assert line_board.last == "S"
    os.close(reader)
    os.close(writer)
