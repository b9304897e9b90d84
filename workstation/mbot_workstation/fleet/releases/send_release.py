"""Send a release of the daemon to a robot, and wait for what becomes of it.

Until the commit nothing there changes. After it the robot's updater builds the release, restarts
the daemon with it, and goes back if it runs worse; the robot is out of reach for some seconds.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_protocol.signing import release_archive, release_manifest
from mbot_protocol.signing.release_ledger import BUSY
from mbot_protocol.signing.release_manifest import ReleaseManifest
from mbot_protocol.v1.messages_pb2 import ReleaseBegin, ReleaseList, ReleaseUpdate
from mbot_protocol.wire.keys import RELEASE_BEGIN, RELEASE_CHUNK, RELEASE_COMMIT, RELEASES
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.link.pieces import Link, Progress, PushKind, push_in_pieces

COMMIT_TIMEOUT_S = 120.0
"""The robot reads all of it once more before it answers."""

LONGEST_UPDATE_S = 2700.0
LONGEST_SILENCE_S = 240.0
"""Restart, gate, and back again: 90 s each at the most."""

TAKEN_UP_WITHIN_S = 90.0
LOOK_AGAIN_S = 1.0


PUSH = PushKind(
    RELEASE_BEGIN,
    RELEASE_CHUNK,
    RELEASE_COMMIT,
    COMMIT_TIMEOUT_S,
    "refused the release and runs on",
)


@dataclass(frozen=True, slots=True)
class CheckedRelease:
    """A release on this machine, whole.

    Attributes:
        path: of the archive.
        data, signatures: its manifest as it travels.
        manifest: read.
        size_bytes: of the archive.

    """

    path: Path
    data: bytes
    signatures: bytes
    manifest: ReleaseManifest
    size_bytes: int


def check_release_file(path: Path) -> CheckedRelease:
    """Read a release whole; the robot judges whose signature it is.

    Raises:
        ConfigurationError: it can't be read, or is not a release, or damaged.

    """
    found: list[tuple[bytes, bytes]] = []

    def judge(data: bytes, signatures: bytes) -> ReleaseManifest:
        found.append((data, signatures))
        return release_manifest.decode(data)

    try:
        with path.open("rb") as archive:
            manifest = release_archive.read(archive, judge)
        size_bytes = path.stat().st_size
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror}") from None
    except RefusedError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    return CheckedRelease(path, *found[0], manifest, size_bytes)


def send(link: Link, release: CheckedRelease, on_progress: Progress) -> str:
    """Send a release; returns the number under which the robot installs it.

    Raises:
        RefusedError: the robot says why it does not take it; nothing has changed there.
        UnreachableError: the link broke; send it again.

    """
    begin = ReleaseBegin(
        schema_version=SCHEMA_VERSION,
        robot_id=link.robot_id,
        manifest=release.data,
        signatures=release.signatures,
    )
    with release.path.open("rb") as archive:
        reply = push_in_pieces(link, PUSH, begin, archive, release.size_bytes, on_progress)
    return reply.push_id


def wait_for_outcome(link: Link, push_id: str, on_phase: Callable[[str], None]) -> ReleaseUpdate:
    """Wait until the robot has installed, refused or rolled back what was sent.

    Raises:
        UnreachableError: it was silent for too long, or its updater does nothing.

    """
    began_s = heard_s = time.monotonic()
    while True:
        now_s = time.monotonic()
        try:
            update = link.query(RELEASES, None, ReleaseList).update
            heard_s = now_s
        except UnreachableError:
            update = None
        if update is not None and update.request == push_id:
            if update.phase in BUSY:
                on_phase(update.phase)
            elif not update.goes_on:  # it tidies up; until then the robot takes no order to move
                return update
        elif update is not None and now_s - began_s > TAKEN_UP_WITHIN_S:
            raise UnreachableError(
                f"robot {link.robot_id} has the release, but its updater does nothing: look at "
                "`systemctl status mbot-agent-update` there"
            )
        if now_s - heard_s > LONGEST_SILENCE_S or now_s - began_s > LONGEST_UPDATE_S:
            raise UnreachableError(
                f"robot {link.robot_id} does not say what became of the update: `mbot-agent "
                "releases` there does"
            )
        time.sleep(LOOK_AGAIN_S)
