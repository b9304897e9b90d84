"""A machine of each release, installed by the script that people run; tests in a file share it."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_protocol.errors import MbotError

from ..end_to_end.processes import Daemon, Process, until
from ..robot.fake_board import FakeBoard
from .booted import CHECKOUT, INSIDE, Machine

INSTALL = (str(INSIDE / "deploy/install.sh"), "--without-picamera2")
INSTALL_S = 300.0
CONFIGURATION = "/etc/mbot-agent/config.toml"
SERVICE = "mbot-agent"
UNITS = sorted(path.name for path in (CHECKOUT / "deploy/systemd").iterdir())


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What the tests have measured; `--junitxml` keeps it."""
    reports = [*terminalreporter.getreports("passed"), *terminalreporter.getreports("failed")]
    measured = [
        f"{report.nodeid.rpartition('::')[2]}: {name} {value}"
        for report in reports
        for name, value in report.user_properties
    ]
    if measured:
        terminalreporter.section("measured")
        terminalreporter.write_line("\n".join(measured))


class Robot:
    """An installed machine with a board and a camera.

    Attributes:
        machine: the computer.
        board: what the daemon's port leads to.
        daemon: who pushes to it and drives it from here.
        installed: what the script printed, and how long it took.

    """

    def __init__(
        self, machine: Machine, directory: Path, install: tuple[str, ...] = INSTALL
    ) -> None:
        self.machine = machine
        self.files_before = machine.files()
        began_s = time.monotonic()
        self.installed = machine.run(*install, timeout_s=INSTALL_S)
        self.install_s = time.monotonic() - began_s
        self.board = FakeBoard(devpts=machine.devpts, mode=0o666)
        self.daemon = Daemon(directory, self.board.path)
        models = f'directory = "{directory / "models"}"'
        self.configuration = self.daemon.config.read_text().replace(models, "")

    def configure(self) -> None:
        """Say which camera, board and key."""
        self.machine.write(CONFIGURATION, self.configuration)

    def state(self) -> str:
        """Of the service, as systemd has it."""
        return self.machine.run("systemctl", "is-active", SERVICE).stdout.strip()

    def edit_units(self) -> None:
        """As `systemctl edit` of each unit leaves them."""
        for name in UNITS:
            folder = f"/etc/systemd/system/{name}.d"
            self.machine.says("mkdir", "-p", folder)
            self.machine.write(f"{folder}/override.conf", "[Unit]\nDescription=edited\n")

    def shows(self, name: str) -> str:
        """A property of the service."""
        return self.machine.says("systemctl", "show", "--value", "-p", name, SERVICE)

    def main_pid(self) -> int:
        """Of the daemon, there."""
        return int(self.shows("MainPID"))

    def signal(self, number: signal.Signals) -> None:
        """Send the daemon a signal."""
        self.machine.says("sh", "-c", f"kill -{number.value} {self.main_pid()}")

    def start(self) -> None:
        """`systemctl start`, and wait until nothing is in the way of driving but a model."""
        self.machine.says("systemctl", "reset-failed", SERVICE)
        self.machine.says("systemctl", "start", SERVICE)
        assert until(self.lacks_only_a_model, 20), self.journal()

    def lacks_only_a_model(self) -> bool:
        """Whether it answers, and sees and reaches its board."""
        try:
            faults = self.daemon.status().faults
        except MbotError:
            return False
        return {fault.kind for fault in faults} <= {"no-model"}

    def journal(self) -> str:
        """What the service has said."""
        return self.machine.says("journalctl", "-u", SERVICE, "--no-pager", "-o", "cat")


@pytest.fixture(scope="module", params=["bookworm", "trixie"])
def robot(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Robot]:
    """Installed, configured, not started."""
    directory = tmp_path_factory.mktemp(request.param)
    with Machine(request.param, directory) as machine:
        made = Robot(machine, directory)
        with made.board:
            yield made


@pytest.fixture(scope="module")
def camera(robot: Robot) -> Iterator[Process]:
    """Pictures of noise, from this computer."""
    with robot.daemon.camera() as process:
        yield process
