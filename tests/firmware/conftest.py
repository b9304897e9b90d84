"""Builds the firmware as a person would, and the harness that runs it."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_workstation.virtual.emulated.board_simulator import simulator_program

from ..ran import ran
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
    if broken := os.environ.get("MBOT_FIRMWARE"):  # benchmarks/firmware_mutants.py
        return Path(broken)
    folder = tmp_path_factory.mktemp("firmware")
    _build("make", "-s", "-C", str(CHECKOUT), "firmware", f"FIRMWARE={folder}")
    return folder


@pytest.fixture(scope="session", autouse=True)
def fresh_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Nothing compiled before this session is used."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def simulator(firmware_folder: Path) -> Simulator:
    return Simulator(simulator_program(), firmware_folder / "mbot-deadman.elf")


@pytest.fixture(scope="session")
def drives_on(firmware_folder: Path) -> Path:
    """A firmware without a dead man's switch, as Intel HEX."""
    program = firmware_folder / "drives_on.elf"
    image = program.with_suffix(".hex")
    flags = ("-mmcu=atmega328p", "-std=c11", "-Os", "-Wall", "-Wextra", "-Werror")
    _build("avr-gcc", *flags, "-o", str(program), str(HERE / "drives_on.c"))
    _build("avr-objcopy", "-O", "ihex", str(program), str(image))
    return image


def _build(*command: str) -> None:
    done = ran(*command)
    if done.returncode != 0:
        pytest.fail(f"{' '.join(command)}\n{done.stdout}{done.stderr}", pytrace=False)
