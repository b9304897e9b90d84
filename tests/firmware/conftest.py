"""Builds the firmware as a person would, and the harness that runs it."""

import shutil
import subprocess
from pathlib import Path

import pytest

from .simulated_board import Simulator

HERE = Path(__file__).parent
CHECKOUT = HERE.parents[1]
NEEDS = {
    "avr-gcc": "gcc-avr",
    "avr-objcopy": "binutils-avr",
    "/usr/lib/avr/include/avr/io.h": "avr-libc",
    "gcc": "gcc",
    "/usr/include/stdio.h": "libc6-dev",
    "/usr/include/simavr/sim_avr.h": "libsimavr-dev",
    "/usr/include/libelf.h": "libelf-dev",
    "make": "make",
}


@pytest.fixture(scope="session")
def firmware_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where `make firmware` has put its files."""
    missing = [
        package
        for need, package in NEEDS.items()
        if not (Path(need).exists() if need.startswith("/") else shutil.which(need))
    ]
    if missing:
        pytest.fail(f"missing packages: sudo apt-get install {' '.join(missing)}", pytrace=False)
    folder = tmp_path_factory.mktemp("firmware")
    _build("make", "-s", "-C", str(CHECKOUT), "firmware", f"FIRMWARE={folder}")
    return folder


@pytest.fixture(scope="session")
def simulator(firmware_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Simulator:
    program = tmp_path_factory.mktemp("simulator") / "board_simulator"
    flags = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror")
    source = HERE / "board_simulator.c"
    _build("gcc", *flags, "-o", str(program), str(source), "-lsimavr", "-lelf")
    return Simulator(program, firmware_folder / "mbot-deadman.elf")


def _build(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    if done.returncode != 0:
        pytest.fail(f"{' '.join(command)}\n{done.stdout}{done.stderr}", pytrace=False)
