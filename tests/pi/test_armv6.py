"""The policy by OpenCV's dnn, as on a first Pi Zero: Debian for armel on an emulated ARM1176.

armel has not the calling convention of Raspberry Pi OS, so Zenoh's wheel for ARMv6 does not load:
this is the policy, not the daemon. The emulator refuses instructions the processor does not have.
"""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from .booted import CHECKOUT, ROOTS
from .test_aarch64 import HERE, TOLERANCE, decided

EMULATOR = "/usr/bin/qemu-arm-static"
COMPILER = "arm-linux-gnueabi-gcc"
PACKAGES = "base-files,python3,python3-numpy,python3-opencv,libpython3.11-dev,libblas3,liblapack3"
LIBRARIES = "/usr/lib/arm-linux-gnueabi"
ALTERNATIVES = f"{LIBRARIES}/blas:{LIBRARIES}/lapack"
"""What update-alternatives would link to, had the packages been configured."""


@pytest.fixture(scope="module")
def userland() -> Path:
    """Bookworm's files for armel, whose OpenCV is 4.6; made once, a minute."""
    root = ROOTS / "bookworm-armel-userland"
    if not (root / "whole").exists():
        ROOTS.mkdir(parents=True, exist_ok=True)
        subprocess.run(["rm", "-rf", str(root)], check=True)
        subprocess.run(
            [
                *("mmdebstrap", "--mode=root", "--variant=extract", "--arch=armel"),
                *(f"--include={PACKAGES}", "bookworm", str(root)),
            ],
            check=True,
            capture_output=True,
        )
        _install_msgspec(root)
        subprocess.run(["cp", EMULATOR, str(root / "usr/bin/")], check=True)
        (root / "whole").touch()
    return root


def _install_msgspec(root: Path) -> None:
    """Compiled, since there is no wheel of it."""
    sources = root / "opt/sources"
    pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--no-binary=:all:"]
    subprocess.run([*pip, "-d", str(sources), "msgspec"], check=True, capture_output=True)
    (archive,) = sources.iterdir()
    subprocess.run(["tar", "xf", archive.name], cwd=sources, check=True)
    (package,) = sources.glob("msgspec-*/src/msgspec")
    headers = root / "usr/include"
    found = [f"-I{headers}/python3.11", f"-I{headers}", f"-I{headers}/arm-linux-gnueabi"]
    made = package / "_core.cpython-311-arm-linux-gnueabi.so"
    subprocess.run(
        [COMPILER, "-O1", "-shared", "-fPIC", *found, str(package / "_core.c"), "-o", str(made)],
        check=True,
        capture_output=True,
    )
    subprocess.run(
        ["cp", "-r", str(package), str(root / "usr/lib/python3/dist-packages")], check=True
    )


def test_the_policy_for_armv6_decides_as_the_shipped_one_does_here(
    userland: Path, record_property: Callable[[str, object], None]
) -> None:
    checkout = userland / "checkout"
    subprocess.run(["rm", "-rf", str(checkout)], check=True)
    checkout.mkdir()
    for name in ("shared", "robot"):
        subprocess.run(["cp", "-r", str(CHECKOUT / name), str(checkout)], check=True)
    subprocess.run(["cp", str(HERE / "decide_golden.py"), str(checkout)], check=True)
    subprocess.run(
        [
            *(sys.executable, "-m", "mbot_workstation.main", "export", "models/red-cube.onnx"),
            *("--for-armv6", "-o", str(checkout / "policy.onnx")),
        ],
        cwd=CHECKOUT,
        check=True,
    )
    there = decided(
        *("chroot", str(userland), EMULATOR, "-cpu", "arm1176"),
        *("-E", f"LD_LIBRARY_PATH={ALTERNATIVES}", "-E", "MBOT_POLICY_ONLY=1"),
        *("/usr/bin/python3", "/checkout/decide_golden.py", "/checkout", "policy.onnx"),
    )
    shipped = "models/red-cube.onnx"
    here = decided(sys.executable, str(HERE / "decide_golden.py"), str(CHECKOUT), shipped)
    assert (there["engine"], here["engine"]) == ("OpenCV", "onnxruntime")
    assert len(there["actions"]) == 80
    off = float(np.abs(np.array(there["actions"]) - np.array(here["actions"])).max())
    record_property("actions off by", off)
    assert off <= TOLERANCE
