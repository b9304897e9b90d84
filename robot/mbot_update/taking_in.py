"""A release on its way in: unpacked into root's own folder, verified there, and built."""

import contextlib
import os
import shutil
import time
from collections.abc import Generator
from functools import partial
from pathlib import Path
from typing import IO

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing import release_archive, release_manifest
from mbot_protocol.signing.envelope import RELEASE, Envelope, verify
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.signing.release_ledger import check_release
from mbot_protocol.signing.release_manifest import ReleaseFile, ReleaseManifest
from mbot_update import foreign_files, python_packages, system
from mbot_update.release_folders import ReleaseFolders

BUILD_S = 1800.0
"""A Pi Zero 2 W writes and compiles 1,500 files to its card; 5 s on a PC."""

PYTHON = "/usr/bin/python3"
CLOCK_SLACK_S = 3600.0
"""Time servers correct a clock after a release was installed."""

REQUEST, ARCHIVE = "request", "incoming.tar"
_LARGEST_REQUEST_BYTES = 64


def is_asked(folders: ReleaseFolders) -> bool:
    """Whether there is anything in the inbox to be judged."""
    try:
        with _inbox(folders) as inbox:
            return REQUEST in os.listdir(inbox)  # noqa: PTH208 (a descriptor)
    except RefusedError:
        return folders.inbox.is_symlink()


def open_request(folders: ReleaseFolders) -> tuple[str, IO[bytes]]:
    """The number of the request in the daemon's inbox, and the archive it is for.

    The inbox belongs to a user who is not trusted: no link in it is followed.

    Raises:
        RefusedError: there is none, or what is there are no plain files.

    """
    with _inbox(folders) as inbox:
        with _plain(REQUEST, inbox) as request:
            number = request.read(_LARGEST_REQUEST_BYTES).decode("ascii", "replace")
        if not number.isalnum():
            raise RefusedError("the request in the inbox is damaged: send the release again")
        return number, _plain(ARCHIVE, inbox)


def forget_request(folders: ReleaseFolders) -> None:
    """Empty the inbox, the request first: what it is for must outlive it."""
    with contextlib.suppress(OSError, RefusedError), _inbox(folders) as inbox:
        for name in (REQUEST, ARCHIVE):
            with contextlib.suppress(OSError):
                os.unlink(name, dir_fd=inbox)


def unpack(
    folders: ReleaseFolders, archive: IO[bytes], trusted: tuple[PublicKey, ...] | None
) -> ReleaseManifest:
    """Verify an archive and put its files into `incoming`.

    What is verified are the bytes that are written there, not those that the daemon could still
    change: signature first, then each file's digest on its way.

    Args:
        folders: of this robot.
        archive: open for reading.
        trusted: whose signature counts; None: root vouches for it by having typed its name.

    Raises:
        RefusedError: it is damaged, or no release for this robot.

    """
    if folders.incoming.exists():
        shutil.rmtree(folders.incoming)
    folders.incoming.mkdir(mode=0o700)

    def judge(data: bytes, signatures: bytes) -> ReleaseManifest:
        if trusted is not None:
            sealed = Envelope.with_lines(data, signatures)
            verify(RELEASE, sealed, trusted, system.has_signed)
        manifest = release_manifest.decode(data)
        _check(folders, manifest, data, by_hand=trusted is None)
        (folders.incoming / "manifest.json").write_bytes(data)
        (folders.incoming / "manifest.sig").write_bytes(signatures)
        return manifest

    try:
        return release_archive.read(archive, judge, partial(_place, folders.incoming))
    except OSError as error:
        raise RefusedError(f"cannot take the release in: {error.strerror}") from None


def build(folders: ReleaseFolders, manifest: ReleaseManifest) -> None:
    """Make the release's folder of what lies in `incoming`, with its virtual environment.

    It is built where it will run, since such environments can't be moved.

    Raises:
        RefusedError: it can't be built; nothing that runs has changed.

    """
    if folders.is_whole(manifest.version):
        return
    folder = folders.release(manifest.version)
    if folder.exists():
        shutil.rmtree(folder)
    incoming, venv = folders.incoming, folder / "venv"
    packages = ["-I", "-m", "compileall", "-q", str(venv / "lib")]
    try:
        _run([PYTHON, "-m", "venv", "--system-site-packages", "--without-pip", str(venv)])
        python_packages.unpack_wheels(incoming / "wheels", venv)
        # The service may not write bytecode.
        _run([str(venv / "bin/python"), *packages])
    except (OSError, RefusedError) as error:
        folders.remove(manifest.version)
        raise RefusedError(f"{manifest.version} can't be built here: {error}") from None
    for name in ("deploy", "firmware", "manifest.json", "manifest.sig"):
        if (incoming / name).exists():
            (incoming / name).rename(folder / name)
    folders.finish(manifest.version)


def _run(command: list[str]) -> None:
    if why := system.build(command, BUILD_S):
        raise RefusedError(why)


def _check(
    folders: ReleaseFolders, manifest: ReleaseManifest, data: bytes, *, by_hand: bool
) -> None:
    """Root at the keyboard may go below the floor and try again what was rolled back."""
    version, ledger = manifest.version, folders.ledger
    if by_hand:
        ledger = type(ledger)()
    elif version == folders.current:
        raise RefusedError(f"{version} runs on this robot already")
    else:
        _check_clock(folders)
    wheels = sum(file.size_bytes for file in manifest.files)
    built = folders.is_whole(version)
    needed_bytes = wheels + (0 if built else manifest.installed_bytes)
    check_release(manifest, ledger, system.computer(folders.root), needed_bytes)
    own = folders.release(version) / "manifest.json"
    if built and (not own.is_file() or own.read_bytes() != data):
        raise RefusedError(f"another release of the name {version} is on this robot already")


def _check_clock(folders: ReleaseFolders) -> None:
    """A clock that is behind the installation of what runs would date this one before it."""
    installed_s, now_s = folders.installed_s, time.time()
    if now_s < installed_s - CLOCK_SLACK_S:
        now, installed = (
            time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(s)) for s in (now_s, installed_s)
        )
        raise RefusedError(
            f"the robot's clock is wrong: it says {now}, and what runs was installed at "
            f"{installed}: set it (sudo timedatectl set-time ...); if it is right, install the "
            "release there by deploy/install.sh"
        )


@contextlib.contextmanager
def _place(folder: Path, file: ReleaseFile) -> Generator[IO[bytes]]:
    path = folder / file.path
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as sink:
        yield sink
    path.chmod(0o755 if path.suffix == ".sh" else 0o644)


@contextlib.contextmanager
def _inbox(folders: ReleaseFolders) -> Generator[int]:
    with contextlib.ExitStack() as opened:
        try:
            inbox = opened.enter_context(foreign_files.folder(folders.inbox))
        except OSError as error:
            raise RefusedError(f"there is no release in {folders.inbox}: {error}") from None
        yield inbox


def _plain(name: str, inbox: int) -> IO[bytes]:
    try:
        return foreign_files.plain(name, inbox)
    except OSError as error:
        raise RefusedError(f"there is no {name} in the inbox: {error.strerror or error}") from None
