"""Where releases lie on the robot, and the few ways in which that changes.

`releases/VERSION` is whole if it holds the file `whole`; `current` is a link to the one that runs.
"""

# ruff: noqa: PTH104, PTH211 (through `os` alone, which the tests replace here)

import os
import shutil
from pathlib import Path

from mbot_protocol.errors import RefusedError
from mbot_protocol.files import atomic_file
from mbot_protocol.signing.release_ledger import UNDER_FIRE, Ledger, read_ledger

WHOLE = "whole"
BEFORE_RELEASES = "0-before-releases"
"""What an installation of before there were releases is called: `before_releases.py`."""


class ReleaseFolders:
    """The folders of one robot.

    Attributes:
        root: what stands for /.
        application: /opt/mbot-agent.
        incoming: a release's files before it is built; root's, whatever the daemon does.
        configuration: the robot's config.toml.
        units: root's unit files.
        inbox: where the daemon puts an archive and a request for it.
        lives: how often the release that runs has died young.
        at_work: is there while an updater works.

    """

    def __init__(self, root: Path = Path("/")) -> None:
        self.root = root
        self.application = root / "opt/mbot-agent"
        self.incoming = self.application / "incoming"
        self.configuration = root / "etc/mbot-agent/config.toml"
        self.units = root / "etc/systemd/system"
        self.inbox = root / "var/lib/mbot-agent/releases"
        self.lives = self.application / "lives"
        self.at_work = root / "run/mbot-agent-update"
        self.under_fire = root / "var/lib/mbot-agent" / UNDER_FIRE
        self._ledger_path = self.application / "ledger.json"
        self._link = self.application / "current"

    def release(self, version: str) -> Path:
        """A release's folder."""
        return self.application / "releases" / version

    @property
    def current(self) -> str:
        """The version that `current` leads to; empty: none."""
        try:
            return self._link.readlink().name
        except OSError:
            return ""

    @property
    def ledger(self) -> Ledger:
        """What is remembered; raises RefusedError if that is damaged."""
        return read_ledger(self._ledger_path)

    def note(self, ledger: Ledger) -> None:
        """Remember this from now on; it has reached the disk on return."""
        if ledger != self.ledger:
            atomic_file.replace(self._ledger_path, ledger.to_bytes())

    def is_whole(self, version: str) -> bool:
        """Whether a release has been built to its end."""
        return bool(version) and (self.release(version) / WHOLE).is_file()

    @property
    def installed_s(self) -> float:
        """When the release that runs was built here, in seconds since 1970; 0 if none was."""
        try:
            return (self.release(self.current) / WHOLE).stat().st_mtime
        except OSError:
            return 0.0

    def versions(self) -> list[str]:
        """All whole releases, by name."""
        folder = self.application / "releases"
        names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
        return [name for name in names if self.is_whole(name)]

    def finish(self, version: str) -> None:
        """A release is built: all of it reaches the disk, and only then its mark."""
        os.sync()
        atomic_file.replace(self.release(version) / WHOLE, b"")

    def switch(self, version: str) -> None:
        """Let `current` lead to a whole release, in one step.

        Raises:
            RefusedError: it is not whole.

        """
        if not self.is_whole(version):
            raise RefusedError(f"there is no whole release {version} on this robot")
        if self.current == version:
            return
        new = self._link.with_name("current.new")
        new.unlink(missing_ok=True)
        os.symlink(Path("releases") / version, new)
        os.rename(new, self._link)
        atomic_file.sync_directory(self.application)

    def remove(self, version: str) -> None:
        """Delete a release, its mark first: what is left of a broken-off removal is not whole."""
        folder = self.release(version)
        atomic_file.remove(folder / WHOLE)
        shutil.rmtree(folder, ignore_errors=True)

    def sweep(self, keep: str = "") -> None:
        """Delete all releases but the golden, the current, the previous and this one."""
        ledger = self.ledger
        needed = {keep, ledger.golden, ledger.previous, ledger.came_from, self.current}
        folder = self.application / "releases"
        for path in folder.iterdir() if folder.is_dir() else ():
            if path.name not in needed or not self.is_whole(path.name):
                self.remove(path.name)
        shutil.rmtree(self.incoming, ignore_errors=True)
        if self.current and not self.release(BEFORE_RELEASES).exists():
            shutil.rmtree(self.application / "venv", ignore_errors=True)
        for path in self.application.glob(f"*{atomic_file.TEMPORARY}"):
            atomic_file.remove(path)
