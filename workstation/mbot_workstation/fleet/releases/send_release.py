"""Send a release of the daemon to a robot, and wait for what becomes of it.

Until the commit nothing there changes. After it the robot's updater builds the release, restarts
the daemon with it, and goes back if it runs worse; the robot is out of reach for some seconds.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from google.protobuf.message import Message

from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_protocol.signing import release_archive, release_manifest
from mbot_protocol.signing.release_ledger import BUSY
from mbot_protocol.signing.release_manifest import ReleaseManifest
from mbot_protocol.v1.messages_pb2 import (
    PushChunk,
    PushCommit,
    PushReply,
    ReleaseBegin,
    ReleaseList,
    ReleaseUpdate,
)
from mbot_protocol.wire.keys import (
    CHUNK_BYTES,
    RELEASE_BEGIN,
    RELEASE_CHUNK,
    RELEASE_COMMIT,
    RELEASES,
    Topic,
)
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.link.robot_link import QUERY_TIMEOUT_S, M
from mbot_workstation.wording import one_line

CHUNK_TIMEOUT_S = 10.0
COMMIT_TIMEOUT_S = 120.0
"""The robot reads all of it once more before it answers."""

LONGEST_UPDATE_S = 2700.0
LONGEST_SILENCE_S = 240.0
"""Restart, gate, and back again: 90 s each at the most."""

TAKEN_UP_WITHIN_S = 90.0
LOOK_AGAIN_S = 1.0


class Link(Protocol):
    """What of a `RobotLink` is needed here."""

    @property
    def robot_id(self) -> str:
        """Whose it is."""
        ...

    def query(
        self,
        topic: Topic,
        request: Message | None,
        reply_type: type[M],
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> M:
        """Ask the robot and wait for its one reply."""
        ...


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


def send(link: Link, release: CheckedRelease, on_progress: Callable[[int, int], None]) -> str:
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
    push_id = _accepted(link, link.query(RELEASE_BEGIN, begin, PushReply)).push_id
    sent = 0
    with release.path.open("rb") as archive:
        while piece := archive.read(CHUNK_BYTES):
            chunk = PushChunk(
                schema_version=SCHEMA_VERSION, push_id=push_id, offset_bytes=sent, data=piece
            )
            _accepted(link, link.query(RELEASE_CHUNK, chunk, PushReply, CHUNK_TIMEOUT_S))
            sent += len(piece)
            on_progress(sent, release.size_bytes)
    commit = PushCommit(schema_version=SCHEMA_VERSION, push_id=push_id)
    _accepted(link, link.query(RELEASE_COMMIT, commit, PushReply, COMMIT_TIMEOUT_S))
    return push_id


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


def _accepted(link: Link, reply: PushReply) -> PushReply:
    if not reply.accepted:
        raise RefusedError(
            f"robot {link.robot_id} refused the release and runs on: {one_line(reply.reason)}"
        )
    return reply
