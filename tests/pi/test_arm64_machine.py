"""The release for a Pi, installed and driven on a booted Bookworm whose processor is emulated.

A Cortex-A53, as on a Zero 2 W: an instruction that it lacks ends the program. Speed and memory tell
nothing, and there is neither seccomp nor a Pi's hardware. Trixie's systemd-run does not work in the
emulator.
"""

import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.models.signing_key import SigningKey

from ..end_to_end.processes import until
from ..reliability.motion import FORWARD, FORWARD_BOARD
from .booted import CHECKOUT, INSIDE, Machine
from .conftest import SERVICE, Robot
from .release_variants import Releases

Record = Callable[[str, object], None]
FOLDER = CHECKOUT / "out" / "pi-releases"
BINFMT = Path("/proc/sys/fs/binfmt_misc")
PROCESSOR = "cortex-a53"
PARTS = {"cortex-a53": "0xd03", "cortex-a72": "0xd08"}
"""What Linux calls them in /proc/cpuinfo."""

DECISIONS = 40
SLOWLY_S = 120.0

_CPU_INFO = """\
processor\t: 0
BogoMIPS\t: 38.40
Features\t: fp asimd evtstrm crc32 cpuid
CPU implementer\t: 0x41
CPU architecture: 8
CPU variant\t: 0x0
CPU part\t: {part}
CPU revision\t: 4
"""

DROP_IN = """\
[Service]
BindReadOnlyPaths=/opt/cpuinfo:/proc/cpuinfo
TimeoutStartSec=120
TimeoutStopSec=60
ExecStopPost=
ExecStopPost=-/opt/mbot-agent/current/venv/bin/mbot-agent stop-motors
"""
"""Without what root does after the daemon's end: the emulated systemd hangs when it starts it."""

SYSTEMD_RUN = """\
#!/bin/sh
for word; do
    shift
    case $word in
        --property=PrivateNetwork=yes | --property=PrivateIPC=yes) ;;
        *) set -- "$@" "$word" ;;
    esac
done
exec /usr/bin/systemd-run --property=BindReadOnlyPaths=/opt/cpuinfo:/proc/cpuinfo "$@"
"""
"""Comes first on PATH: the emulator cannot make these two namespaces."""


def cpu_info(processor: str) -> str:
    """A Pi's /proc/cpuinfo, of one core: the emulator shows this computer's, which onnxruntime
    believes."""
    return _CPU_INFO.format(part=PARTS[processor])


def emulate_arm64() -> None:
    """Let the kernel run arm64 programs by the emulator."""
    if not (BINFMT / "register").exists():
        subprocess.run(["mount", "-t", "binfmt_misc", "binfmt_misc", str(BINFMT)], check=True)
    if not (BINFMT / "qemu-aarch64").exists():
        (BINFMT / "register").write_text(Path("/usr/lib/binfmt.d/qemu-aarch64.conf").read_text())


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    emulate_arm64()
    directory = tmp_path_factory.mktemp("arm64")
    releases = Releases(FOLDER / "arm64", "bookworm", "arm64")
    archive = releases.make("0.1.0+arm1", 1, SigningKey.ephemeral("releases"))
    there = str(INSIDE / archive.relative_to(CHECKOUT))
    machine = Machine("bookworm", directory, architecture="arm64")
    drop_in = machine.root / f"etc/systemd/system/{SERVICE}.service.d/emulated.conf"
    drop_in.parent.mkdir(parents=True)
    drop_in.write_text(DROP_IN)
    (machine.root / "opt/cpuinfo").write_text(cpu_info(PROCESSOR))
    run = machine.root / "usr/local/bin/systemd-run"
    run.write_text(SYSTEMD_RUN)
    run.chmod(0o755)
    settings = machine.root / "etc/systemd/system.conf.d/processor.conf"
    settings.parent.mkdir()
    settings.write_text(f"[Manager]\nDefaultEnvironment=QEMU_CPU={PROCESSOR}\n")
    with machine:
        install = ("env", f"QEMU_CPU={PROCESSOR}", str(INSIDE / "deploy/install.sh"))
        made = Robot(machine, directory, (*install, "--without-picamera2", there))
        with made.board:
            yield made


def test_the_release_for_a_pi_installs(robot: Robot, record_property: Record) -> None:
    record_property("installed in s", round(robot.install_s))
    assert robot.installed.returncode == 0, robot.installed.stdout + robot.installed.stderr
    python = "/opt/mbot-agent/current/venv/bin/python"
    machine = robot.machine.says(python, "-c", "import platform; print(platform.machine())")
    assert machine == "aarch64"


def test_it_drives_forty_decisions(robot: Robot, record_property: Record) -> None:
    robot.configure()
    with robot.daemon.camera():
        began_s = time.monotonic()
        robot.machine.says("systemctl", "start", SERVICE)
        record_property("start to READY s", round(time.monotonic() - began_s, 1))
        assert until(robot.lacks_only_a_model, SLOWLY_S), robot.journal()
        robot.daemon.push(FORWARD)
        assert until(robot.daemon.is_ready, SLOWLY_S), robot.journal()
        assert not robot.board.moved
        robot.daemon.run()
        assert robot.board.wait_for(*FORWARD_BOARD, timeout_s=SLOWLY_S), robot.journal()
        first = robot.daemon.status().decisions
        assert until(lambda: robot.daemon.status().decisions >= first + DECISIONS, SLOWLY_S)
        with robot.daemon.link() as link:
            RemoteControl(link).stop()
        assert robot.board.wait_for(0, 0)


def test_its_end_stops_the_motors(robot: Robot) -> None:
    robot.machine.says("systemctl", "stop", SERVICE)
    assert robot.state() == "inactive", robot.journal()
    assert robot.board.speeds == (0, 0)
    assert "Traceback" not in robot.journal()
