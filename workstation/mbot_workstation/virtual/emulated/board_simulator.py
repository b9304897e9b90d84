"""The program that emulates the board, compiled from `board_simulator.c` when first needed."""

import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from mbot_protocol.errors import ConfigurationError

SOURCE = Path(__file__).with_name("board_simulator.c")
COMMAND = ("gcc", "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror")
LIBRARIES = ("-lsimavr", "-lelf")
PACKAGES = "gcc libc6-dev libsimavr-dev libelf-dev"
COMPILE_TIMEOUT_S = 60.0


def cache_folder() -> Path:
    """Where compiled programs are kept from one run to the next."""
    caches = os.environ.get("XDG_CACHE_HOME")
    return (Path(caches) if caches else Path.home() / ".cache") / "mbot-agent"


def simulator_program(folder: Path | None = None) -> Path:
    """The compiled program; the first call compiles it, which takes a second.

    Args:
        folder: where to keep it; `cache_folder()` if not given.

    Raises:
        ConfigurationError: compiler or libraries are missing, or the folder can't be written.

    """
    folder = folder or cache_folder()
    made_of = SOURCE.read_bytes() + " ".join((*COMMAND, *LIBRARIES)).encode()
    program = folder / f"board_simulator-{hashlib.sha256(made_of).hexdigest()[:16]}"
    if program.exists():
        return program
    if shutil.which(COMMAND[0]) is None:
        raise ConfigurationError(
            f"emulating a board needs a C compiler and simavr: sudo apt-get install {PACKAGES}"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as made:
            fresh = Path(made) / "board_simulator"
            _compile(fresh)
            fresh.replace(program)  # whole or not at all, whoever else compiles it now
    except OSError as error:
        raise ConfigurationError(
            f"can't write {folder}: {error.strerror}; set XDG_CACHE_HOME to a folder of yours"
        ) from None
    return program


def _compile(program: Path) -> None:
    done = subprocess.run(
        [*COMMAND, "-o", str(program), str(SOURCE), *LIBRARIES],
        capture_output=True,
        text=True,
        errors="replace",
        env=os.environ | {"LC_ALL": "C"},
        timeout=COMPILE_TIMEOUT_S,
        check=False,
    )
    if done.returncode != 0:
        told = [line for line in done.stderr.splitlines() if "error" in line or "cannot" in line]
        raise ConfigurationError(
            f"can't compile the board's emulator ({' '.join(told[:1]) or 'no reason given'}): "
            f"sudo apt-get install {PACKAGES}"
        )
