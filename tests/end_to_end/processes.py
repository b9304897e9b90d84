"""The real programs as child processes: the daemon, a camera, a workstation."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Self

from mbot_protocol.errors import MbotError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.signing_key import SigningKey

from ..free_port import free_port
from ..until import until

HERE = Path(__file__).parent
LONGER_THAN_FORGIVEN_S = 2.5
"""A gap of camera, board or link that takes `run` to drive on (control.longest_hold_s)."""
ROBOT_ID = "mbot-test"
PROGRAMS = str(Path(sys.executable).with_name("{}"))


def beats_on(status: Callable[[], Status], times: int = 2) -> bool:
    """Whether the loop begins and ends so many beats from now on.

    For what must not happen: a beat ends after the board has acknowledged what it drives, so
    whatever has set the robot in motion before the call shows by then.
    """
    under_way = status().decisions + 1
    return until(lambda: status().decisions >= under_way + times)


def freeze(pid: int) -> None:
    """SIGSTOP, and wait until it holds: on a busy machine a thread may run on for a while."""
    os.kill(pid, signal.SIGSTOP)
    assert until(lambda: set(_thread_states(pid)) == {"T"}), f"process {pid} does not stand still"


def _thread_states(pid: int) -> list[str]:
    """One letter a thread, as proc(5) has them. The name before it may hold anything but ')'."""
    stats = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/stat")]
    return [stat.rpartition(")")[2].split()[0] for stat in stats]


class Process:
    """A child process; killed at the end if it is still there. Its output goes to a file."""

    def __init__(self, *command: str, log: Path, environment: dict[str, str] | None = None) -> None:
        self._log = log
        with log.open("ab") as output:
            self._child = subprocess.Popen(
                command,
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=os.environ | (environment or {}),
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._child.poll() is None:
            self._child.kill()
            self._child.send_signal(signal.SIGCONT)
        self._child.wait(10)

    @property
    def output(self) -> str:
        return self._log.read_text()

    @property
    def pid(self) -> int:
        return self._child.pid

    def signal(self, number: signal.Signals) -> None:
        self._child.send_signal(number)

    def freeze(self) -> None:
        freeze(self.pid)

    def wait(self, timeout_s: float = 15.0) -> int:
        return self._child.wait(timeout_s)

    def is_running(self) -> bool:
        return self._child.poll() is None


def camera(port: int, log: Path) -> Process:
    return Process(sys.executable, str(HERE / "camera_process.py"), str(port), log=log)


def workstation(*arguments: str, log: Path) -> Process:
    return Process(PROGRAMS.format("workstation"), *arguments, log=log)


class Daemon:
    """Everything needed to run mbot-agent in a test, and to talk to it.

    Attributes:
        address: where it listens.
        key: signs what is pushed; the robot trusts it.
        camera_port: where it looks for an MJPEG stream.

    """

    def __init__(self, directory: Path, board: str, *, start: str = "idle") -> None:
        self.directory = directory
        self.key = SigningKey.ephemeral("test")
        self.camera_port = free_port()
        self.address = f"127.0.0.1:{free_port()}"
        self.log = directory / "daemon.log"
        self.config = directory / "robot.toml"
        self.config.write_text(
            f"""
            robot_id = "{ROBOT_ID}"
            [camera]
            source = "http://127.0.0.1:{self.camera_port}/stream.mjpg"
            [board]
            port = "{board}"
            accept_no_deadman = true
            [control]
            start = "{start}"
            [models]
            directory = "{directory / "models"}"
            [trust]
            keys = ["{self.key.public.line}"]
            [network]
            listen = ["tcp/{self.address}"]
            """
        )

    def start(self, *, environment: dict[str, str] | None = None) -> Process:
        command = (PROGRAMS.format("mbot-agent"), "run", "--config", str(self.config))
        return Process(*command, log=self.log, environment=environment)

    def camera(self) -> Process:
        return camera(self.camera_port, self.directory / "camera.log")

    def link(self) -> RobotLink:
        return RobotLink(self.address)

    def status(self) -> Status:
        with self.link() as link:
            return link.status()

    def is_up(self) -> bool:
        return until(lambda: "is up" in self.log.read_text(), 20)

    def is_ready(self) -> bool:
        """Whether it answers and nothing is in the way of driving."""
        try:
            return not self.status().faults
        except MbotError:
            return False

    def push(self, model: bytes) -> None:
        from mbot_workstation.fleet.models.push import push

        path = self.directory / "model.onnx"
        path.write_bytes(model)
        with self.link() as link:
            push(link, path, lambda _: self.key)

    def run(self) -> None:
        """As soon as it can: the camera may not have been seen yet."""
        with self.link() as link:
            RemoteControl(link).run(when_ready=True)
