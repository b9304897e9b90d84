"""An installation of before there were releases, taken over as if it were one.

`/opt/mbot-agent/venv` becomes a release of its own name, by links: the same programs at the same
place, started by the same unit. From then on the first real release takes its place as any release
takes another's, and it comes back if that runs worse. Killed at any moment, the old daemon is what
starts, and taking over can be done again.
"""

# ruff: noqa: PTH104, PTH211 (as release_folders.py)

import os
import shutil
import tomllib

from mbot_protocol.errors import RefusedError
from mbot_update import system
from mbot_update.release_folders import BEFORE_RELEASES, ReleaseFolders


def take_over(folders: ReleaseFolders) -> None:
    """Make a release of the old installation, if there is one; nothing is restarted.

    Raises:
        RefusedError: it would begin to drive if it had to be brought back.

    """
    venv, unit = folders.application / "venv", folders.units / system.SERVICE
    if not venv.is_dir() or folders.current not in ("", BEFORE_RELEASES) or unit.is_symlink():
        return
    if not (venv / "bin/mbot-agent").is_file() or not unit.is_file():
        # Nothing that could run: it was broken off, or uninstalled halfway.
        shutil.rmtree(venv)
        return
    if system.service().pid and _drives_by_itself(folders):
        raise RefusedError(
            'the daemon runs and [control] start is "running": it would drive when it is '
            "restarted; stop it first (systemctl stop mbot-agent)"
        )
    folder = folders.release(BEFORE_RELEASES)
    shutil.rmtree(folder, ignore_errors=True)
    own_unit = folder / "deploy/systemd" / system.SERVICE
    own_unit.parent.mkdir(parents=True)
    shutil.copyfile(unit, own_unit)
    os.symlink(venv, folder / "venv")
    folders.finish(BEFORE_RELEASES)
    folders.switch(BEFORE_RELEASES)
    link = unit.with_name(f"{unit.name}.new")
    link.unlink(missing_ok=True)
    os.symlink(f"/opt/mbot-agent/current/deploy/systemd/{system.SERVICE}", link)
    os.rename(link, unit)
    system.reload_units()


def _drives_by_itself(folders: ReleaseFolders) -> bool:
    try:
        found = tomllib.loads(folders.configuration.read_text())
        return found.get("control", {}).get("start", "idle") != "idle"
    except (OSError, ValueError, AttributeError):
        return True
