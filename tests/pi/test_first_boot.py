"""A card made by `workstation setup-card` boots: its robot is ready, and nobody has typed."""

import io
import tarfile
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from mbot_protocol.errors import MbotError
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases.boot_card import CardContent, prepare

from ..end_to_end.processes import until
from ..reliability.motion import FORWARD, FORWARD_BOARD
from ..robot.fake_board import FakeBoard
from .booted import Machine
from .conftest import CONFIGURATION, Robot
from .release_variants import Releases
from .test_updates import FOLDER, running

VERSION = "0.1.0+card"
BOOT = "/boot/firmware"
KEY_FILE = "etc/mbot-agent/tls/robot.key"
BY_IMAGER = f"root=x systemd.run={BOOT}/firstrun.sh systemd.unit=kernel-command-line.target\n"


def certificates() -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as tar:
        entry = tarfile.TarInfo(KEY_FILE)
        entry.size, entry.mode, entry.uname, entry.gname = 3, 0o640, "root", "mbot-agent"
        tar.addfile(entry, io.BytesIO(b"key"))
    return packed.getvalue()


def boot_by_firstrun(machine: Machine) -> None:
    """As Bookworm does: Imager's script in a boot of its own, then a real one."""
    machine.says("sh", f"{BOOT}/firstrun.sh")
    machine.says("test", "-e", "/imagers-own-work")
    machine.cut_power()
    machine.__enter__()


def boot_with_a_power_cut(machine: Machine) -> None:
    """In the middle of the installation, which is before that boot has ended."""
    machine.says("sh", f"{BOOT}/firstrun.sh")
    machine.cut_power()
    incoming = machine.root / "opt/mbot-agent/incoming"
    watch = threading.Thread(target=lambda: until(incoming.exists, 60) and machine.cut_power())
    watch.start()
    with pytest.raises(AssertionError):
        machine.__enter__()
    watch.join()
    assert incoming.exists()
    machine.__enter__()


def boot_by_cloud_init(machine: Machine) -> None:
    """What it has been told to run."""
    machine.says("sh", f"{BOOT}/mbot/first-boot.sh", "now")


@pytest.mark.parametrize(
    ("system", "files", "boot"),
    [
        (
            "bookworm",
            {"cmdline.txt": BY_IMAGER, "firstrun.sh": "#!/bin/sh\ntouch /imagers-own-work\n"},
            boot_by_firstrun,
        ),
        (
            "bookworm",
            {"cmdline.txt": BY_IMAGER, "firstrun.sh": "#!/bin/sh\ntouch /imagers-own-work\n"},
            boot_with_a_power_cut,
        ),
        ("trixie", {"cmdline.txt": "root=x\n", "user-data": "#cloud-config\n"}, boot_by_cloud_init),
    ],
)
def test_a_card_sets_its_robot_up(
    system: str,
    files: dict[str, str],
    boot: Callable[[Machine], None],
    tmp_path: Path,
    record_property: Callable[[str, object], None],
) -> None:
    release = Releases(FOLDER, system).make(VERSION, 1, SigningKey.ephemeral("releases"))
    with Machine(system, tmp_path) as machine:
        robot = Robot(machine, tmp_path, ("true",))
        partition = tmp_path / system / BOOT.lstrip("/")
        partition.mkdir(parents=True)
        for name, text in (files | {"config.txt": ""}).items():
            (partition / name).write_text(text)
        prepare(partition, CardContent(release, robot.configuration, certificates(), False))
        boot(machine)
        if boot is not boot_by_cloud_init:  # the old one went with the machine
            old, robot.board = robot.board.path, FakeBoard(devpts=machine.devpts, mode=0o666)
            assert robot.board.path == old
        with robot.board, robot.daemon.camera():
            log = f"{BOOT}/mbot-set-up.log"
            assert until(lambda: is_running(robot), 120), machine.run("cat", log).stdout
            assert "mbot-agent is set up" in machine.read(log)
            assert not (partition / "mbot").exists()
            assert machine.run("ls", "/etc/systemd/system/mbot-set-up.service").returncode != 0
            assert machine.says("stat", "-c", "%U:%G %a", CONFIGURATION) == "root:mbot-agent 640"
            assert machine.says("stat", "-c", "%U:%G %a", f"/{KEY_FILE}") == "root:mbot-agent 640"
            assert machine.run("systemctl", "is-enabled", "mbot-agent").returncode == 0
            robot.daemon.push(FORWARD)
            assert until(robot.daemon.is_ready)
            assert not robot.board.moved
            robot.daemon.run()
            assert robot.board.wait_for(*FORWARD_BOARD, timeout_s=15), robot.journal()


def is_running(robot: Robot) -> bool:
    try:
        return running(robot) == VERSION
    except MbotError:
        return False
