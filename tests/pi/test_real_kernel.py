"""The installed service on a kernel of its own: its camera, its USB port, its limits, its disk.

In an emulated PC with Trixie. Each test leaves the next one a machine that runs.
"""

import contextlib
import hashlib
import json
import random
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mbot_protocol.errors import MbotError

from ..end_to_end.processes import Daemon, beats_on, until
from ..reliability.motion import FORWARD, FORWARD_BOARD, driven_since
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .booted import Machine
from .conftest import CONFIGURATION, INSTALL, INSTALL_S, SERVICE
from .virtual_machine import PACKAGES, VirtualMachine, add_picamera2, make_disk

Record = Callable[[str, object], None]
UNIT = "/etc/systemd/system/mbot-agent.service"
SLOWLY_S = 120.0
"""For what a computer does at once that is ten times faster."""


class Bench:
    """A disk, and the machine that has booted it last.

    Attributes:
        machine: the computer.
        board: at the other end of its USB cable.
        daemon: who pushes to it and drives it from here.

    """

    machine: VirtualMachine

    def __init__(self, root: Path, disk: Path, board: FakeBoard, daemon: Daemon) -> None:
        self.board = board
        self.daemon = daemon
        self._parts = root, disk, board.path, int(daemon.address.rpartition(":")[2])

    def boot(self) -> VirtualMachine:
        """Switch it on."""
        self.machine = VirtualMachine(*self._parts)
        return self.machine

    def faults(self) -> set[str] | None:
        """That the daemon reports; None while it does not answer."""
        try:
            return {fault.kind for fault in self.daemon.status().faults}
        except MbotError:
            return None

    def waits_for(self, *faults: str) -> bool:
        """Whether it comes to report these and no others."""
        return until(lambda: self.faults() == set(faults), SLOWLY_S)

    def journal(self) -> str:
        """What the service has said."""
        return self.machine.says("journalctl", "-u", SERVICE, "--no-pager", "-o", "cat")

    def in_its_place(self, program: str) -> list[str]:
        """What a program of /opt/guest prints, run by the daemon's unit instead of the daemon."""
        place = f"/etc/systemd/system/{Path(program).stem}.service"
        python = "/opt/mbot-agent/current/venv/bin/python"
        run = f"ExecStart={python} /opt/guest/{program}"
        edits = ["s/^ExecStopPost=.*//", f"s|^ExecStart=.*|{run}|", "s/^Type=.*/Type=oneshot/"]
        edits += ["s/^Restart=.*/Restart=no/", "s/^WatchdogSec=.*//", "s/^OnFailure=.*//"]
        edits += ["s/^TimeoutStartSec=.*/TimeoutStartSec=200/"]
        script = ";".join(edits)
        self.machine.says("sh", "-c", f"sed '{script}' {UNIT} > {place}")
        self.machine.says("systemctl", "daemon-reload")
        self.machine.run("systemctl", "start", Path(place).name, timeout_s=220)
        said = self.machine.says(
            *("journalctl", "-t", "python", "-u", Path(place).name, "--no-pager", "-o", "cat")
        )
        assert said, self.machine.says("journalctl", "-u", Path(place).name, "--no-pager")
        return said.splitlines()


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    """Installed by the script in a container, then booted from a disk of its own."""
    directory = tmp_path_factory.mktemp("kernel")
    with Machine("trixie", directory, PACKAGES) as machine:
        installed = machine.run(*INSTALL, timeout_s=INSTALL_S)
        assert installed.returncode == 0, installed.stdout + installed.stderr
    add_picamera2(machine.root)
    with FakeBoard() as board:
        daemon = Daemon(directory, board.path)
        text = daemon.config.read_text()
        text = text.replace(f"http://127.0.0.1:{daemon.camera_port}/stream.mjpg", "/dev/video0")
        text = text.replace(f'"{board.path}"', '"/dev/ttyUSB0"')
        text = text.replace(f'directory = "{directory / "models"}"', "")
        machine.write(CONFIGURATION, text)
        disk = directory / "disk"
        make_disk(machine.root, disk, int(daemon.address.rpartition(":")[2]))
        bench = Bench(machine.root, disk, board, daemon)
        with bench.boot():
            yield bench
            bench.machine.cut_power()


def test_it_starts_at_boot_and_sees_its_camera_and_its_board(
    bench: Bench, record_property: Record
) -> None:
    record_property("booted in s", round(bench.machine.boot_s))
    assert bench.waits_for("no-model"), bench.journal()
    assert not bench.board.moved


def test_it_drives_within_its_memory(bench: Bench, record_property: Record) -> None:
    bench.daemon.push(FORWARD)
    assert bench.waits_for(), bench.journal()
    bench.daemon.run()
    assert bench.board.wait_for(*FORWARD_BOARD, timeout_s=SLOWLY_S), bench.journal()
    peak = int(bench.machine.says("systemctl", "show", "--value", "-p", "MemoryPeak", SERVICE))
    record_property("memory peak, dry run and files read included, MB", peak >> 20)
    assert peak < 320 << 20


def test_a_plug_pulled_out_and_in_again_leaves_it_standing(bench: Bench) -> None:
    bench.machine.pull_out_board()
    assert bench.waits_for("board-lost"), bench.faults()
    assert until(lambda: bench.daemon.status().last_stop.why, SLOWLY_S), "a long gap disarms"
    before_s = time.monotonic()
    bench.machine.plug_in_board()
    assert bench.waits_for(), bench.journal()
    assert bench.board.speeds == (0, 0)
    assert beats_on(bench.daemon.status)
    assert driven_since(bench.board, before_s) == 0
    bench.daemon.run()
    assert bench.board.wait_for(*FORWARD_BOARD, timeout_s=SLOWLY_S), bench.journal()


def test_its_unit_gives_it_camera_and_board_and_little_else(bench: Bench) -> None:
    trials, *rest = bench.in_its_place("probe_sandbox.py")
    assert json.loads(trials) == {
        "camera": "done",
        "board": "EBUSY",  # the daemon has it, for itself alone
        "heap": "done",
        "null": "done",
        "tun": "EPERM",
        "fuse": "EPERM",
        "own state": "done",
        "others' state": "EROFS",
        "own program": "EACCES",
        "neighbour": "done",
        "internet": "EPERM",
        "code": "EACCES",
        "clock": "EPERM",
    }
    assert rest == []
    ended = bench.machine.says("systemctl", "show", "-p", "Result,ExecMainStatus", "probe_sandbox")
    assert sorted(ended.split()) == ["ExecMainStatus=9", "Result=signal"]


def test_the_real_picamera2_works_in_its_unit(bench: Bench, record_property: Record) -> None:
    lines = bench.in_its_place("real_picamera2.py")
    assert lines[-1].startswith("{"), lines
    said = json.loads(lines[-1])
    record_property("said", said)
    assert said["cameras"] == 1
    assert "gives NV12 by picamera2" in said["in another format"]
    assert said["shape"] == said["again"] == [360, 320]
    assert all(0 <= age_s < 5 for age_s in said["ages s"])
    assert said["light held"] is False  # this camera has no automatics


def test_after_a_power_cut_it_stands_and_has_what_it_had_acknowledged(
    bench: Bench, record_property: Record
) -> None:
    model = constant_model(0.3, 0.2)
    bench.daemon.push(model)
    bench.machine.cut_power()
    began_s = time.monotonic()
    bench.boot().__enter__()
    record_property("there again after s", round(bench.machine.boot_s))
    assert bench.waits_for(), bench.journal()
    assert bench.daemon.status().active_model.sha256 == hashlib.sha256(model).hexdigest()
    assert driven_since(bench.board, began_s) == 0


def test_a_power_cut_in_the_middle_of_a_push_leaves_a_whole_model(
    bench: Bench, record_property: Record
) -> None:
    before = bench.daemon.status().active_model.sha256
    model = constant_model(0.2, 0.3)
    after_s = random.uniform(0.0, 2.0)  # another moment each time
    record_property("cut after s", after_s)

    def push() -> None:
        with contextlib.suppress(MbotError):
            bench.daemon.push(model)

    pusher = threading.Thread(target=push)
    pusher.start()
    time.sleep(after_s)
    bench.machine.cut_power()
    pusher.join()
    bench.boot().__enter__()
    assert bench.waits_for(), bench.journal()
    active = bench.daemon.status().active_model.sha256
    assert active in (before, hashlib.sha256(model).hexdigest())
