"""A robot's disk with releases on it, small archives, and a system that does as it is told."""

import io
import subprocess
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from mbot_protocol.daemon_state import DaemonState
from mbot_protocol.signing import release_archive, release_manifest
from mbot_protocol.signing.envelope import RELEASE
from mbot_protocol.signing.release_ledger import Computer
from mbot_protocol.signing.release_manifest import ReleaseManifest
from mbot_update import health_gate, system
from mbot_update.release_folders import ReleaseFolders
from mbot_update.system import Service
from mbot_workstation.fleet.models.signing_key import SigningKey

KEY = SigningKey.ephemeral("releases")
SPARE = SigningKey.ephemeral("spare")
COMPUTER = Computer("bookworm", "arm64", "3.11", 10**10)
HEALTHY = Service("active", 7, DaemonState(False, ("no-model",)), "success", 0)


def saying(words: str) -> Service:
    """As a daemon that says this in its status text."""
    return replace(HEALTHY, report=system.report_in_words(words))


def wheel(**files: bytes) -> bytes:
    """A wheel's bytes, uncompressed; double underscores in a name are slashes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(f"{name.replace('__', '/')}.py"), content)
    return packed.getvalue()


FILES = {
    "requirements.txt": b"mbot-agent==0.1.0\n",
    "wheels/mbot_agent-0.1.0-py3-none-any.whl": wheel(mbot_agent__main=b"# a wheel\n" * 300),
    "deploy/systemd/mbot-agent.service": b"[Service]\n",
    "deploy/install.sh": b"#!/bin/sh\n",
    "firmware/mbot-deadman.hex": b":00000001FF\n",
}


def archive(
    folder: Path,
    version: str = "0.2",
    sequence: int = 2,
    keys: tuple[SigningKey, ...] = (KEY,),
    change: Callable[[ReleaseManifest], ReleaseManifest] = lambda manifest: manifest,
) -> Path:
    """Write a small release."""
    files = folder / f"files-{version}"
    for name, content in FILES.items():
        path = files / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    described = tuple(release_archive.described(files, name) for name in sorted(FILES))
    manifest = change(
        ReleaseManifest(version, sequence, sequence, "bookworm", "arm64", "3.11", 1000, described)
    )
    data = release_manifest.encode(manifest)
    signatures = "".join(key.sign(RELEASE, data).line for key in keys)
    path = folder / f"{version}.tar"
    with path.open("wb") as file:
        release_archive.write(file, files, data, signatures.encode(), described)
    return path


def signed_manifest(path: Path) -> tuple[bytes, bytes]:
    """A release's manifest and its signatures, as any tar reads them."""
    with tarfile.open(path) as archive:
        first, second = (archive.extractfile(name) for name in ("manifest.json", "manifest.sig"))
        assert first is not None
        assert second is not None
        return first.read(), second.read()


@dataclass
class FakeSystem:
    """In the place of `mbot_update.system`'s functions.

    Attributes:
        before: asked before anything happens, with its name; may raise.
        starts: whether a version gets READY.
        tried: why `mbot-agent try` of a version fails; empty: it does not.
        service: what systemd says now.
        up: whether the machine is not shutting down.
        restarted: versions, in the order in which they were restarted.

    """

    folders: ReleaseFolders
    before: Callable[[str], None] = lambda _: None
    starts: Callable[[str], bool] = lambda _: True
    tried: dict[str, str] = field(default_factory=dict[str, str])
    service: Service = HEALTHY
    up: bool = True
    restarted: list[str] = field(default_factory=list[str])

    def build(self, command: list[str], _: float) -> str:
        self.before("build")
        if "venv" in command:
            (Path(command[-1]) / "bin").mkdir(parents=True)
            (Path(command[-1]) / "lib/python3.11/site-packages").mkdir(parents=True)
        return ""

    def restart(self) -> bool:
        self.before("restart")
        self.restarted.append(self.folders.current)
        return self.starts(self.folders.current)

    def as_daemon(self, command: list[str], _: float) -> subprocess.CompletedProcess[str]:
        self.before("try")
        why = self.tried.get(Path(command[0]).parents[2].name, "")
        return subprocess.CompletedProcess(command, 1 if why else 0, "", why)

    def computer(self, _: Path) -> Computer:
        return COMPUTER

    def show(self) -> Service:
        return self.service

    def nothing(self) -> None:
        self.before("systemctl")


class Robot:
    """A root folder with one release that runs, and an inbox."""

    def __init__(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folders = ReleaseFolders(root)
        self.system = FakeSystem(self.folders)
        self.folders.inbox.mkdir(parents=True)
        self.folders.configuration.parent.mkdir(parents=True)
        self.folders.configuration.write_text(
            f'[trust]\nrelease_keys = ["{KEY.public.line}", "{SPARE.public.line}"]\n'
        )
        monkeypatch.setattr(system, "build", self.system.build)
        monkeypatch.setattr(system, "restart", self.system.restart)
        monkeypatch.setattr(system, "start_without_waiting", self.system.restart)
        monkeypatch.setattr(system, "as_daemon", self.system.as_daemon)
        monkeypatch.setattr(system, "computer", self.system.computer)
        monkeypatch.setattr(system, "service", self.system.show)
        monkeypatch.setattr(system, "is_up", lambda: self.system.up)
        monkeypatch.setattr(system, "reload_units", self.system.nothing)
        monkeypatch.setattr(health_gate, "STAYS_S", 0.0)
        monkeypatch.setattr(health_gate, "HEALTHY_WITHIN_S", 0.3)

    def has(self, version: str) -> None:
        """A whole release on its disk."""
        program = self.folders.release(version) / "venv/bin/mbot-agent"
        program.parent.mkdir(parents=True)
        program.write_text("#!/bin/sh\n")
        self.folders.finish(version)

    def runs(self, version: str = "0.1") -> None:
        """This one is the first, and current."""
        self.has(version)
        self.folders.switch(version)
        self.folders.note(replace(self.folders.ledger, golden=version, floor=1))

    def receives(self, path: Path, number: str = "a1") -> None:
        """As the daemon leaves it for the updater."""
        (self.folders.inbox / "incoming.tar").write_bytes(path.read_bytes())
        (self.folders.inbox / "request").write_text(number)
