"""Releases for booted machines: a good one, and others that fail in a known way."""

import base64
import hashlib
import zipfile
from pathlib import Path

from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases.make_release import build_wheel, make_release
from mbot_workstation.fleet.releases.robot_wheels import TARGETS

from .booted import CHECKOUT

CACHE = CHECKOUT / "out" / "dist-cache"

NOT_STARTING = "\nraise SystemExit('this release does not import')\n"
NOT_READY = """
import sys
if "run" in sys.argv:
    raise SystemExit("this release starts and ends")
"""
DYING = """
import os, sys, threading
if "run" in sys.argv:
    threading.Timer(12.0, os._exit, (9,)).start()
"""
"""Later than the gate looks, and soon enough for systemd's start limit."""

CURIOUS = """
import os, socket, sys
if "try" in sys.argv:
    def reached(attempt):
        try:
            attempt()
        except OSError:
            return False
        return True
    attempts = {
        "the network": lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM),
        "systemd": lambda: socket.socket(socket.AF_UNIX).connect("/run/dbus/system_bus_socket"),
        "the board": lambda: os.stat("/dev/ttyUSB0"),
        "the models": lambda: open("/var/lib/mbot-agent/models/x", "w"),
        "the inbox": lambda: open("/var/lib/mbot-agent/releases/request", "w"),
        "the daemon": lambda: os.stat("/proc/1/cmdline"),
    }
    found = [name for name, attempt in attempts.items() if reached(attempt)]
    raise SystemExit(f"as {os.getuid()} it reached {found}")
"""
"""Looks around where it is tried, and says what it could reach."""


class Releases:
    """Makes releases for one system, all from one wheel.

    Attributes:
        system: such as "bookworm".
        target: that system on a PC, if nothing else was asked for.

    """

    def __init__(self, folder: Path, system: str, architecture: str = "amd64") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.system = system
        self._folder = folder
        self.target = next(t for t in TARGETS if t.name == f"{system}-{architecture}")
        self._wheel = build_wheel(folder, epoch_s=1, sdist=False)

    def make(self, version: str, sequence: int, key: SigningKey, code: str = "") -> Path:
        """An archive of the daemon with some code in front of its own."""
        wheel = self._folder / "changed" / self._wheel.name
        wheel.parent.mkdir(exist_ok=True)
        _with_code(self._wheel, wheel, code)
        return make_release(
            self.target, wheel, version, sequence, sequence, [key], self._folder, CACHE, None
        )


def _with_code(source: Path, target: Path, code: str) -> None:
    main = "mbot_agent/main.py"
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        text = old.read(main).decode()
        start = text.index("# Nothing is imported up here")
        changed = (text[:start] + code + text[start:]).encode()
        digest = base64.urlsafe_b64encode(hashlib.sha256(changed).digest()).rstrip(b"=").decode()
        for entry in old.infolist():
            data = old.read(entry)
            if entry.filename == main:
                data = changed
            elif entry.filename.endswith("/RECORD"):
                lines = data.decode().splitlines()
                own = f"{main},sha256={digest},{len(changed)}"
                data = "\n".join(
                    own if line.startswith(f"{main},") else line for line in lines
                ).encode()
            new.writestr(entry, data)
