"""What the updater asks of the system, by the programs that every Debian has."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol import daemon_state
from mbot_protocol.daemon_state import FILE, LARGEST_BYTES, DaemonState
from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.signing.release_ledger import Computer
from mbot_update import foreign_files
from mbot_update.ed25519_check import is_signed

SERVICE = "mbot-agent.service"
PUTS_BACK = "mbot-agent-rollback.service"
USER = "mbot-agent"
RESTART_S = 90.0
"""More than the unit's TimeoutStopSec and TimeoutStartSec together."""

STATE_DIRECTORY = daemon_state.DIRECTORY

WRONG_CONFIGURATION = 2
"""The daemon's exit status for it."""


UP = ("initializing", "starting", "running", "degraded", "maintenance")


class GoingDownError(Exception):
    """The machine is shutting down: nothing that fails now tells anything about a release."""


@dataclass(frozen=True, slots=True)
class Service:
    """The daemon, as systemd has it.

    Attributes:
        state: such as "active".
        pid: 0 if it does not run.
        report: what it says of itself; None: nothing.
        result, exit_status: of its last end.

    """

    state: str
    pid: int
    report: DaemonState | None
    result: str
    exit_status: int

    @property
    def faults(self) -> frozenset[str]:
        """The kinds of fault it reports."""
        return frozenset(self.report.faults if self.report else ())

    @property
    def is_armed(self) -> bool:
        """Whether its wheels turn or would as soon as they can."""
        return self.report is not None and self.report.armed


def service() -> Service:
    """How the daemon is now."""
    names = ("ActiveState", "MainPID", "ExecMainStartTimestampMonotonic", "StatusText")
    found = _shown(*names, "Result", "ExecMainStatus")
    pid = int(found.get("MainPID") or 0)
    began_ns = int(found.get("ExecMainStartTimestampMonotonic") or 0) * 1000
    return Service(
        found.get("ActiveState", ""),
        pid,
        _report(pid, began_ns) or report_in_words(found.get("StatusText", "")),
        found.get("Result", ""),
        int(found.get("ExecMainStatus") or 0),
    )


def _report(pid: int, began_ns: int) -> DaemonState | None:
    """What this very process says in its file; None if there is no such file.

    Older units leave a newer one's file behind, and so may one that was killed.
    """
    try:
        with (
            foreign_files.folder(STATE_DIRECTORY) as folder,
            foreign_files.plain(FILE, folder) as file,
        ):
            state = DaemonState.from_bytes(file.read(LARGEST_BYTES + 1))
    except OSError:
        return None
    is_its_own = state is not None and state.pid == pid and state.monotonic_ns >= began_ns
    return state if is_its_own else None


def report_in_words(words: str) -> DaemonState | None:
    """From a status text, such as "idle; camera-lost".

    Daemons up to 0.1 write no file. This can go once no robot has one of those as its golden or
    previous release: with 0.3 at the earliest.
    """
    state, _, faults = words.partition(";")
    if not state:
        return None
    return DaemonState(state in ("running", "manual", "fault"), tuple(faults.split()))


def lived_s() -> float:
    """From the daemon's last start to its end."""
    names = ("ExecMainStartTimestampMonotonic", "ExecMainExitTimestampMonotonic")
    found = _shown(*names)
    began_us, ended_us = (int(found.get(name) or 0) for name in names)
    return max(0, ended_us - began_us) / 1e6


def is_up() -> bool:
    """Whether systemd answers, and not because it ends everything."""
    return _run(["systemctl", "is-system-running"], 20).stdout.strip() in UP


def reload_units() -> None:
    """Let systemd read the daemon's unit again, which lies in its release."""
    _run(["systemctl", "daemon-reload"], 60)


def restart() -> bool:
    """Restart the daemon; whether it got READY."""
    _run(["systemctl", "reset-failed", SERVICE], 20)
    return _run(["systemctl", "restart", SERVICE], RESTART_S).returncode == 0


def start_without_waiting() -> None:
    """Start the daemon some time soon."""
    _run(["systemctl", "reset-failed", SERVICE], 20)
    _run(["systemctl", "--no-block", "start", SERVICE], 20)


def start_putting_back() -> None:
    """As if systemd had given the daemon up."""
    _run(["systemctl", "--no-block", "start", PUTS_BACK], 20)


CONFINED = (
    # No board and no camera, no network, not the running daemon's processes and files.
    *("PrivateDevices=yes", "DevicePolicy=closed", "PrivateNetwork=yes", "PrivateTmp=yes"),
    *("ProtectSystem=strict", "ProtectHome=yes", "ProtectProc=invisible", "PrivateIPC=yes"),
    *("RestrictAddressFamilies=AF_UNIX", "InaccessiblePaths=-/run/dbus -/run/systemd/private"),
    # As the daemon's unit.
    *("NoNewPrivileges=yes", "CapabilityBoundingSet=", "RestrictSUIDSGID=yes"),
    *("ProtectKernelTunables=yes", "ProtectKernelModules=yes", "ProtectKernelLogs=yes"),
    *("ProtectControlGroups=yes", "ProtectClock=yes", "ProtectHostname=yes"),
    *("RestrictNamespaces=yes", "RestrictRealtime=yes", "LockPersonality=yes"),
    *("MemoryDenyWriteExecute=yes", "SystemCallArchitectures=native"),
    *("SystemCallFilter=@system-service", "SystemCallFilter=~@privileged @resources"),
    *("SystemCallErrorNumber=EPERM", "MemoryMax=320M", "TasksMax=128", "LimitCORE=0", "UMask=0077"),
)
"""What a release that has yet to show itself may do: read, and compute."""


def as_daemon(command: list[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
    """A command as the daemon's user, who may only read and compute in it.

    It ends after that time, also if this process is killed meanwhile.
    """
    settings = [f"User={USER}", f"RuntimeMaxSec={timeout_s:.0f}", *CONFINED]
    alone = ["systemd-run", "--quiet", "--wait", "--pipe", "--collect"]
    alone += [f"--property={setting}" for setting in settings]
    state = "--setenv=STATE_DIRECTORY=/var/lib/mbot-agent"
    return _run([*alone, state, "--", *command], timeout_s + 20)


def build(command: list[str], timeout_s: float) -> str:
    """Run what builds a release; returns why it failed, in one line, or nothing."""
    done = _run(command, timeout_s)
    if done.returncode == 0:
        return ""
    lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    return lines[-1][:300] if lines else f"exit status {done.returncode}"


def computer(root: Path) -> Computer:
    """What this robot is."""
    release = _text(root / "etc/os-release")
    name = re.search(r'^VERSION_CODENAME="?([a-z]*)', release, re.MULTILINE)
    return Computer(
        name[1] if name else "unknown",
        _run(["dpkg", "--print-architecture"], 20).stdout.strip() or "unknown",
        f"{sys.version_info.major}.{sys.version_info.minor}",
        shutil.disk_usage(root / "opt").free,
    )


def release_keys(configuration: Path) -> tuple[PublicKey, ...]:
    """The keys whose releases are taken, from the configuration that only root can write.

    Raises:
        RefusedError: it can't be read.

    """
    try:
        found = tomllib.loads(configuration.read_text()).get("trust", {}).get("release_keys", [])
        return tuple(PublicKey.parse(line) for line in found)
    except (OSError, ValueError, AttributeError, TypeError, ConfigurationError) as error:
        raise RefusedError(f"cannot read the release keys in {configuration}: {error}") from None


def has_signed(key: PublicKey, message: bytes, signature: bytes) -> bool:
    """As `PublicKey.has_signed`, without PyNaCl."""
    return is_signed(key.raw, message, signature)


def _shown(*names: str) -> dict[str, str]:
    """Properties of the daemon's unit; without those that systemd does not tell."""
    asked = ["systemctl", "show", SERVICE, *(f"--property={name}" for name in names)]
    parts = [line.partition("=") for line in _run(asked, 20).stdout.splitlines()]
    return {name: value for name, _, value in parts}


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""


def _run(command: list[str], timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Run a program; one that takes too long or is not there has failed, with its reason."""
    try:
        return subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            timeout=timeout_s,
            env=os.environ | {"LC_ALL": "C.UTF-8"},
            check=False,
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 124, "", f"took over {timeout_s:.0f} s")
    except OSError as error:
        return subprocess.CompletedProcess(command, 127, "", f"{command[0]}: {error.strerror}")
