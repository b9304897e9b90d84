"""Which firmware the emulated board runs: a file, or ours, compiled."""

import shutil
import subprocess
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.firmware.flashing import read_image

OURS = "deadman"
"""The word for deploy/firmware: compiled when it isn't, or has changed."""

CHECKOUT = Path(__file__).parents[4]
MAKE_TIMEOUT_S = 120.0
PACKAGES = "make gcc-avr binutils-avr avr-libc"

_ELF_MAGIC = b"\x7fELF"
_ELF_MACHINE = slice(18, 20)
_AVR = (83).to_bytes(2, "little")  # EM_AVR, System V ABI's registry


def find_firmware(given: str) -> Path:
    """The file for `deadman` or a path, checked.

    Raises:
        ConfigurationError: there is no such file, it is not a program for an mCore board, or ours
            can't be compiled.

    """
    path = _compile_ours() if given == OURS else Path(given)
    if path.suffix.lower() == ".hex":
        read_image(path)
        return path.absolute()
    try:
        with path.open("rb") as file:
            head = file.read(_ELF_MACHINE.stop)
    except OSError as error:
        raise ConfigurationError(
            f"no firmware at {path} ({error.strerror}); give an ELF or Intel HEX file, or "
            f"{OURS!r} for ours"
        ) from None
    if not head.startswith(_ELF_MAGIC) or head[_ELF_MACHINE] != _AVR:
        raise ConfigurationError(
            f"{path} is not firmware of an mCore board: expected an ELF file for AVR, or Intel HEX "
            "in a file that ends in .hex"
        )
    return path.absolute()


def _compile_ours() -> Path:
    """What `make firmware` makes, at the place where it makes it."""
    if not (CHECKOUT / "deploy" / "firmware").is_dir():
        raise ConfigurationError(
            "our firmware's source is not in an installed package; run this in the checkout, or "
            "give a firmware's file"
        )
    if missing := [tool for tool in ("make", "avr-gcc", "avr-objcopy") if not shutil.which(tool)]:
        raise ConfigurationError(
            f"compiling our firmware needs {missing[0]}: sudo apt-get install {PACKAGES}"
        )
    done = subprocess.run(
        ["make", "-s", "-C", str(CHECKOUT), "firmware"],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=MAKE_TIMEOUT_S,
        check=False,
    )
    if done.returncode != 0:
        told = done.stderr.strip().splitlines() or ["it said nothing"]
        raise ConfigurationError(f"`make firmware` failed: {told[0]}")
    return CHECKOUT / "out" / "firmware" / "mbot-deadman.elf"
