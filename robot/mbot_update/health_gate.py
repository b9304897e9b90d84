"""Does a new release run as well as the old one did?

Before it is made current: does it start, read the configuration and decide with the active model,
standing beside the daemon that runs? After: is it READY within the unit's time, does it stay, and
does it report no fault of board or camera that the old one did not? Nothing else is held against
it: no battery, no temperature, no camera that was missing before.
"""

import time

from mbot_update import system
from mbot_update.release_folders import BEFORE_RELEASES, ReleaseFolders
from mbot_update.system import Service

TRY_S = 120.0
"""Imports, the configuration and a decision: 1 s on a PC."""

HEALTHY_WITHIN_S = 30.0
"""From READY until board and camera are as before: a board takes 3.5 s, a camera 2."""

STAYS_S = 5.0
"""So long it must have run by then."""

LOOKED_AT = ("board-", "camera-")


def would_not_run(folders: ReleaseFolders, version: str, old: str) -> str:
    """Why a release would not run, tried beside what runs; empty: it would.

    What the old release can't do either, such as read a configuration with a mistake in it, is not
    held against the new one.
    """
    if version == BEFORE_RELEASES:  # which did run, and knows no `try`
        return ""
    why = _tried(folders, version)
    if why and old != BEFORE_RELEASES and folders.is_whole(old) and _tried(folders, old):
        return ""
    return why


def is_worse(before: Service, old: str = "") -> str:
    """Restart the daemon; why that is worse than before, or nothing.

    Args:
        before: how the old release was.
        old: its version; one of before there were releases does not say its faults.

    """
    if not system.restart():
        return "it did not get READY"
    first = system.service()
    began_s = time.monotonic()
    allowed = _looked_at(before)
    while True:
        now = system.service()
        if now.state != "active" or now.pid != first.pid:
            return "it got READY and died"
        worse = frozenset[str]() if old == BEFORE_RELEASES else _looked_at(now) - allowed
        so_far_s = time.monotonic() - began_s
        if not worse and now.report and so_far_s >= STAYS_S:
            return ""
        if so_far_s >= HEALTHY_WITHIN_S:
            return f"worse than before: {', '.join(sorted(worse)) or 'it says nothing'}"
        time.sleep(0.2)


def _looked_at(service: Service) -> frozenset[str]:
    return frozenset(kind for kind in service.faults if kind.startswith(LOOKED_AT))


def _tried(folders: ReleaseFolders, version: str) -> str:
    program = str(folders.release(version) / "venv/bin/mbot-agent")
    done = system.as_daemon([program, "try", "--config", str(folders.configuration)], TRY_S)
    if done.returncode == 0:
        return ""
    lines = (done.stderr or done.stdout).strip().splitlines()
    return lines[-1][:300] if lines else f"it ended with {done.returncode}"
