"""Writing a firmware onto an mCore board through its boot loader, with avrdude."""

import os
import re
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import serial
from serial.tools import list_ports

from mbot_protocol.drive.mcore import (
    BAUD_RATE,
    CH340,
    VERSION_REQUEST,
    ReplyParser,
    VersionReply,
    has_deadman,
    stop_burst,
)
from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError

STOCK_VERSIONS = ("06.", "1.2.")
"""What the versions of Makeblock's mCore firmware begin with (measured on three)."""

ROOM_BYTES = 32_768 - 512
"""The ATmega328P's flash memory without the boot loader (data sheet; Arduino Uno's boot loader)."""

ANSWER_TIMEOUT_S = 6.0
"""Opening the port resets the board; from there to an answer it takes 2.6 to 3.5 s (measured)."""

ASK_AGAIN_S = 0.2
AVRDUDE_TIMEOUT_S = 120.0


class NoAnswerError(UnreachableError):
    """The port can be used, but nothing on it answers as an mCore's firmware does."""


@dataclass(frozen=True, slots=True)
class Image:
    """A firmware to be written.

    Attributes:
        path: the Intel HEX file.
        content: its bytes, in the order of the file.

    """

    path: Path
    content: bytes

    @property
    def deadman_version(self) -> str | None:
        """The version that this image will answer with, if it is our own firmware."""
        found = re.search(rb"mbot-deadman \d+( \d+ms)?", self.content)
        return found.group().decode() if found else None


def read_image(path: Path) -> Image:
    """Read an Intel HEX file and check that it is whole and has room on the board.

    Raises:
        ConfigurationError: no such file, not Intel HEX, damaged, or too large.

    """
    try:
        lines = path.read_text("ascii").split()
    except FileNotFoundError:
        raise ConfigurationError(f"no firmware at {path}: `make firmware` makes ours") from None
    except (OSError, UnicodeDecodeError):
        raise ConfigurationError(f"{path} cannot be read as an Intel HEX file") from None
    content = bytearray()
    ended = False
    for number, line in enumerate(lines, 1):
        record = _record(line)
        if record is None or ended:
            raise ConfigurationError(f"{path} is not an Intel HEX file, or damaged (line {number})")
        if record[3] == 0:
            content += record[4:-1]
        ended = record[3] == 1
    if not ended or not content:
        raise ConfigurationError(f"{path} ends too early: its last record is missing")
    if len(content) > ROOM_BYTES:
        raise ConfigurationError(f"{path} has {len(content)} bytes, an mCore holds {ROOM_BYTES}")
    return Image(path, bytes(content))


def _record(line: str) -> bytes | None:
    """One line's bytes: size, address (2), type, data, checksum. None if they do not add up."""
    try:
        record = bytes.fromhex(line.removeprefix(":"))
    except ValueError:
        return None
    whole = line.startswith(":") and len(record) >= 5 and len(record) == record[0] + 5
    return record if whole and sum(record) % 256 == 0 else None


def find_port(given: str | None) -> str:
    """The port given, or that of the only CH340 on USB.

    Raises:
        UnreachableError: none was given, and none or several were found.

    """
    if given is not None:
        return given
    found = [port.device for port in list_ports.comports() if (port.vid, port.pid) == CH340]
    if not found:
        raise UnreachableError(
            "no mCore board on USB (CH340, 1a86:7523): plug it in and switch it on; if lsusb shows "
            "it, brltty may have taken it (apt remove brltty)"
        )
    if len(found) > 1:
        raise UnreachableError(f"several boards on USB: choose with --port: {', '.join(found)}")
    return found[0]


def ask_version(port: str) -> str:
    """Stop the board's motors and ask its firmware for its version.

    Raises:
        NoAnswerError: nothing answered in 6 s.
        UnreachableError: the port cannot be used.

    """
    parser = ReplyParser()
    try:
        with serial.Serial(port, BAUD_RATE, timeout=ASK_AGAIN_S, exclusive=True) as line:
            line.write(stop_burst())
            deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
            while time.monotonic() < deadline_s:
                line.write(VERSION_REQUEST)
                again_s = time.monotonic() + ASK_AGAIN_S
                while time.monotonic() < again_s:
                    for reply in parser.feed(line.read(max(1, line.in_waiting))):
                        if isinstance(reply, VersionReply):
                            return reply.version
    except (OSError, ValueError) as error:
        raise UnreachableError(_explain(port, error)) from None
    raise NoAnswerError(f"nothing on {port} answers like an mCore board")


def _explain(port: str, error: Exception) -> str:
    if not os.path.lexists(port):
        return f"no board at {port}: is it plugged in and switched on?"
    if not os.access(port, os.R_OK | os.W_OK):
        return f"no permission for {port}: add yourself to the group dialout and log in again"
    if "lock" in str(error).lower() or "busy" in str(error).lower():
        return f"{port} is in use by another process (fuser {port} names it); stop mbot-agent first"
    return f"cannot use {port}: {error}"


def is_known_board(version: str) -> bool:
    """Whether an mCore's firmware, stock or our own, names itself like this."""
    return version.startswith(STOCK_VERSIONS) or has_deadman(version)


def avrdude_command(port: str, image: Image) -> list[str]:
    """How the image gets onto the board: by its boot loader, which writes without an erasure."""
    chip = ("-c", "arduino", "-p", "m328p", "-P", port, "-b", str(BAUD_RATE))
    return ["avrdude", *chip, "-D", "-U", f"flash:w:{image.path}:i"]


def need_avrdude() -> None:
    """Refuse to begin without the program that writes.

    Raises:
        ConfigurationError: avrdude is not installed.

    """
    if shutil.which("avrdude") is None:
        raise ConfigurationError("avrdude is missing: sudo apt-get install avrdude")


def write(port: str, image: Image) -> None:
    """Write the image and have it read back.

    Raises:
        RefusedError: another chip, or what was read back differs.
        UnreachableError: the port cannot be used, or no boot loader answers.

    """
    need_avrdude()
    try:
        done = subprocess.run(
            avrdude_command(port, image),
            capture_output=True,
            text=True,
            errors="replace",
            env=os.environ | {"LC_ALL": "C"},
            stdin=subprocess.DEVNULL,
            timeout=AVRDUDE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise UnreachableError(
            f"avrdude did not end in {AVRDUDE_TIMEOUT_S:.0f} s: unplug the board and try again"
        ) from None
    if done.returncode != 0:
        _fail(port, done.stderr + done.stdout)


def _fail(port: str, said: str) -> None:
    """Raise what avrdude's many lines come down to; versions 6 and 7 word them differently."""
    low = said.lower()
    if "permission denied" in low:
        raise UnreachableError(_explain(port, PermissionError("permission denied")))
    if "open port" in low or "open device" in low or "busy" in low:
        raise UnreachableError(_explain(port, OSError(_first_line(said))))
    if "not in sync" in low or "not responding" in low:
        raise UnreachableError(
            f"no boot loader answers on {port}: switch the board off and on and try again; if it "
            "never answers, the board needs a programmer"
        )
    if re.search(r"expected signature|differs in signature|not match|invalid device sig", low):
        raise RefusedError(
            f"the chip on {port} is not an ATmega328P, so this is not an mCore board"
        )
    if "verif" in low and ("mismatch" in low or "error" in low):
        raise RefusedError(f"{port}: what was written reads back differently; try again")
    raise UnreachableError(f"avrdude failed: {_first_line(said)}")


def _first_line(said: str) -> str:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower() or "fail" in line.lower()]
    return (telling or lines or ["it said nothing"])[0]


def check_flashed(port: str, image: Image) -> str:
    """The version that the board answers with now.

    Raises:
        UnreachableError: it does not answer.
        RefusedError: it answers with another version than our image would.

    """
    try:
        version = ask_version(port)
    except UnreachableError as error:
        raise UnreachableError(f"the firmware is written, but then: {error}") from None
    expected = image.deadman_version
    if expected is not None and version != expected:
        raise RefusedError(f"the board calls itself {version}, expected {expected}; flash it again")
    return version
