"""The daemon's code and libraries as on a Pi, on an emulated Cortex-A53 and A72.

The emulator refuses instructions that the processor does not have. Its speed and memory tell
nothing, and it has no seccomp.
"""

import json
import signal
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ..end_to_end.processes import Daemon, Process, beats_on
from ..reliability.motion import FORWARD, FORWARD_BOARD
from ..robot.fake_board import FakeBoard
from ..until import until
from .booted import CHECKOUT, ROOTS
from .test_arm64_machine import DECISIONS, PARTS, SLOWLY_S, cpu_info, emulate_arm64

EMULATOR = "/usr/bin/qemu-aarch64-static"
PACKAGES = "base-files,python3,libpython3-stdlib,libstdc++6,libgcc-s1,zlib1g,libc-bin"
PYTHONS = {"bookworm": "3.11", "trixie": "3.13"}
SITE, HERE = "opt/site", Path(__file__).parent
MODEL = "models/red-cube.onnx"
TOLERANCE = 1e-5
"""The bar for another processor."""

ROOM = """
mount -t proc proc {root}/proc
mount --bind {root}/cpuinfo {root}/proc/cpuinfo
mount --rbind /dev {root}/dev
mount -t tmpfs tmpfs {root}/tmp
export QEMU_CPU={processor} PYTHONPATH=/checkout/robot:/checkout/shared/protocol:/{site}
exec chroot {root} /usr/bin/python3 -m mbot_agent.main run --config /robot.toml
"""
"""The daemon in the userland, in mounts of its own."""


def requirements() -> list[str]:
    """What a robot needs."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    return [*project["dependencies"], *project["optional-dependencies"]["robot"]]


@pytest.fixture(scope="module", params=PYTHONS)
def userland(request: pytest.FixtureRequest) -> Path:
    """A release's files for arm64 with the robot's packages; made once, some minutes."""
    release: str = request.param
    root = ROOTS / f"{release}-arm64-userland"
    if not (root / "whole").exists():
        ROOTS.mkdir(parents=True, exist_ok=True)
        subprocess.run(["rm", "-rf", str(root)], check=True)
        subprocess.run(
            [
                *("mmdebstrap", "--mode=root", "--variant=extract", "--arch=arm64"),
                *(f"--include={PACKAGES}", release, str(root)),
            ],
            check=True,
            capture_output=True,
        )
        install_libraries(root, release)
        subprocess.run(["cp", EMULATOR, str(root / "usr/bin/")], check=True)
        (root / "whole").touch()
    return root


def install_libraries(root: Path, release: str) -> None:
    """What a robot needs, put into a release's files."""
    version = PYTHONS[release]
    platforms = [f"manylinux_2_{minor}_aarch64" for minor in range(17, 37)]
    platforms.append("manylinux2014_aarch64")
    constraints = CHECKOUT / f"deploy/constraints-{release}.txt"
    subprocess.run(
        [
            *(sys.executable, "-m", "pip", "install", "-q", "--only-binary=:all:"),
            *(word for name in platforms for word in ("--platform", name)),
            *("--python-version", version, "--implementation", "cp"),
            *("--abi", f"cp{version.replace('.', '')}", "--abi", "abi3", "--abi", "none"),
            *("--target", str(root / SITE)),
            *(("-c", str(constraints)) if constraints.exists() else ()),
            *requirements(),
        ],
        check=True,
        capture_output=True,
    )


@pytest.mark.parametrize("processor", PARTS)
def test_every_module_imports_and_the_policy_decides_as_here(
    userland: Path, processor: str, record_property: Callable[[str, object], None]
) -> None:
    put_checkout(userland)
    subprocess.run(["cp", str(HERE / "decide_golden.py"), str(userland / "checkout")], check=True)
    there = decided(
        *("chroot", str(userland), f"/{EMULATOR.lstrip('/')}", "-cpu", processor),
        *("/usr/bin/python3", "/checkout/decide_golden.py", "/checkout", MODEL, f"/{SITE}"),
    )
    here = decided(sys.executable, str(HERE / "decide_golden.py"), str(CHECKOUT), MODEL)
    assert there["machine"] == "aarch64"
    assert there["modules"] == here["modules"]
    assert len(there["modules"]) > 60
    off = float(np.abs(np.array(there["actions"]) - np.array(here["actions"])).max())
    record_property("actions off by", off)
    assert off <= TOLERANCE


@pytest.mark.parametrize("processor", PARTS)
def test_the_daemon_drives_forty_decisions(userland: Path, processor: str, tmp_path: Path) -> None:
    put_checkout(userland)
    emulate_arm64()
    (userland / "cpuinfo").write_text(cpu_info(processor))
    with FakeBoard() as board:
        daemon = Daemon(tmp_path, board.path)
        text = daemon.config.read_text().replace(str(tmp_path / "models"), "/models")
        (userland / "robot.toml").write_text(text)
        subprocess.run(["rm", "-rf", str(userland / "models")], check=True)
        inside = ROOM.format(root=userland, processor=processor, site=SITE)
        command = ("unshare", "--mount", "sh", "-ec", inside)
        with daemon.camera(), Process(*command, log=daemon.log) as process:
            assert until(lambda: "is up" in process.output or not process.is_running(), SLOWLY_S)
            assert process.is_running(), process.output
            daemon.push(FORWARD)
            assert until(daemon.is_ready, SLOWLY_S), process.output
            assert not board.moved
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=SLOWLY_S), process.output
            assert beats_on(daemon.status, DECISIONS)
            process.signal(signal.SIGTERM)
            process.wait(SLOWLY_S)
            assert board.speeds == (0, 0)
            assert "Traceback" not in process.output


def put_checkout(root: Path) -> None:
    """This checkout's code, as it is now."""
    checkout = root / "checkout"
    subprocess.run(["rm", "-rf", str(checkout)], check=True)
    checkout.mkdir()
    for name in ("shared", "robot", "models"):
        subprocess.run(["cp", "-r", str(CHECKOUT / name), str(checkout)], check=True)


def decided(*command: str) -> dict[str, Any]:
    """What `decide_golden.py` prints."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])
