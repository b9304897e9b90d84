"""A release that was accepted and dies later, but too seldom for systemd to give up.

The daemon's unit tells root of each end (`ExecStopPost`). What dies ten times before it has once
lived for an hour goes back, however many days and boots lie in between. Ends that were asked for
count for nothing, nor do those by a wrong configuration, in an update, by the machine's own end, or
by the watchdog while somebody floods the daemon; a power cut is none. Afterwards only what systemd
counts is held against a release: it was not the release that changed.
"""

import os
import time

from mbot_protocol.files import atomic_file
from mbot_update import system
from mbot_update.release_folders import ReleaseFolders

SHORT_S = 3600.0
TOO_MANY = 10
"""As StartLimitBurst= of the daemon's unit."""

UNDER_FIRE_S = 30.0
"""The watchdog's 5 s, the 3 s that its abort may take, and the motors' stop, doubled."""

BY_FIRE = ("watchdog", "oom-kill")
"""What a flood of messages can come to."""

PROVEN = "proven"


def count_end(folders: ReleaseFolders) -> None:
    """The daemon has just ended, as systemd says in $SERVICE_RESULT and $EXIT_STATUS."""
    version = folders.current
    if not version or _record(folders, version) == PROVEN or folders.at_work.exists():
        return
    if system.lived_s() >= SHORT_S:
        _note(folders, version, PROVEN)
    elif _died(folders) and system.is_up():
        _note(folders, version, str(short_lives(folders) + 1))
        if too_many(folders):
            system.start_putting_back()


def short_lives(folders: ReleaseFolders) -> int:
    """How often the release that runs has died young; 0 once it has lived long."""
    record = _record(folders, folders.current)
    return int(record) if record.isdecimal() else 0


def too_many(folders: ReleaseFolders) -> bool:
    """Whether the release that runs has died young too often."""
    return short_lives(folders) >= TOO_MANY


def start_over(folders: ReleaseFolders) -> None:
    """Another release runs, or the same one has been put there once more."""
    atomic_file.remove(folders.lives)


def is_under_fire(folders: ReleaseFolders) -> bool:
    """Whether the daemon has told of a flood just before now."""
    try:
        ago_s = time.time() - folders.under_fire.stat().st_mtime
    except OSError:
        return False
    return abs(ago_s) <= UNDER_FIRE_S


def _died(folders: ReleaseFolders) -> bool:
    result, status = (os.environ.get(name, "") for name in ("SERVICE_RESULT", "EXIT_STATUS"))
    asked_for = result in ("", "success")
    misconfigured = (result, status) == ("exit-code", str(system.WRONG_CONFIGURATION))
    under_fire = result in BY_FIRE and is_under_fire(folders)
    return not asked_for and not misconfigured and not under_fire


def _record(folders: ReleaseFolders, version: str) -> str:
    """What is noted of this version; nothing if the file is another's, or unreadable."""
    try:
        named, _, record = folders.lives.read_text().strip().partition(" ")
    except (OSError, ValueError):
        return ""
    return record if named == version else ""


def _note(folders: ReleaseFolders, version: str, record: str) -> None:
    atomic_file.replace(folders.lives, f"{version} {record}\n".encode())
