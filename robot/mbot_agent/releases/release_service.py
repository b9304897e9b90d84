"""Answers `releases/...`: takes a release in, verifies it, and asks root's updater to install it.

The daemon has no right to install anything. It writes the archive to its own folder, piece by
piece, and at the end a request; the updater verifies everything again.
"""

import contextlib
import logging
import os
import platform
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO

from mbot_agent.intake import SENDER, Intake, replied
from mbot_agent.releases.own_release import ARCHIVE, REQUEST, update_goes_on
from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.files import atomic_file
from mbot_protocol.signing import release_archive, release_manifest
from mbot_protocol.signing.envelope import RELEASE, Envelope, verify
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.signing.release_ledger import APPLICATION, Computer, check_release, read_ledger
from mbot_protocol.signing.release_manifest import ReleaseManifest
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire import keys
from mbot_protocol.wire.schema import SCHEMA_VERSION, decode

log = logging.getLogger(__name__)

LONGEST_S = 1800.0
"""A release of 100 MB then needs 56 kB/s."""

_ARCHITECTURES = {"aarch64": "arm64", "x86_64": "amd64"}


@dataclass(frozen=True, slots=True)
class _Push:
    """One on its way in: its manifest as announced, and what there is of the archive."""

    manifest: bytes
    file: IO[bytes]


class ReleaseService:
    """The replies. Used by one thread.

    What a sender who has fallen silent has left stays on the disk until the next push or start: the
    control loop, which looks after such things elsewhere, touches no disk.
    """

    def __init__(
        self,
        robot_id: str,
        trusted: tuple[PublicKey, ...],
        inbox: Path,
        is_armed: Callable[[], bool],
        running: str,
        application: Path = APPLICATION,
    ) -> None:
        """Answer for a robot.

        Args:
            robot_id: whose releases.
            trusted: the keys whose signature counts.
            inbox: where the updater looks.
            is_armed: whether the robot may move by itself now.
            running: the release this daemon runs from; empty: none.
            application: where releases are installed.

        """
        self._robot_id = robot_id
        self._trusted = trusted
        self._inbox = inbox
        self._is_armed = is_armed
        self._running = running
        self._application = application
        self._intake = Intake[_Push](LONGEST_S, self._drop)

    @property
    def answers(self) -> dict[str, Callable[[bytes], bytes]]:
        """What answers which key below `releases/`."""
        return {
            keys.RELEASE_BEGIN.name: lambda payload: self._reply(self._begin, payload),
            keys.RELEASE_CHUNK.name: lambda payload: self._reply(self._intake.add, payload),
            keys.RELEASE_COMMIT.name: lambda payload: self._reply(self._commit, payload),
            keys.RELEASES.name: self.releases,
        }

    def sweep(self) -> None:
        """Delete what an earlier start has left half received."""
        if not update_goes_on(self._inbox):
            atomic_file.remove(self._inbox / ARCHIVE)

    def releases(self, _: bytes) -> bytes:
        """Reply to `releases/list`."""
        reply = messages.ReleaseList(schema_version=SCHEMA_VERSION, running=self._running)
        try:
            ledger = read_ledger(self._application / "ledger.json")
            for path in sorted((self._application / "releases").glob("*/whole")):
                version = path.parent.name
                reply.releases.add(
                    version=version,
                    previous=version == ledger.previous,
                    golden=version == ledger.golden,
                )
            outcome = ledger.outcome
            reply.update.request = outcome.request
            reply.update.version = outcome.version
            reply.update.phase = outcome.phase
            reply.update.detail = outcome.detail
            reply.update.goes_on = update_goes_on(self._inbox)
            reply.accepted = True
        except MbotError as error:
            reply.reason = str(error)
        return reply.SerializeToString()

    def _reply(self, act: Callable[[bytes, messages.PushReply], None], payload: bytes) -> bytes:
        def try_it(reply: messages.PushReply) -> None:
            self._check_standing()
            try:
                act(payload, reply)
            except OSError as error:
                raise RefusedError(
                    f"cannot keep the release in {self._inbox}: {error.strerror}"
                ) from None

        return replied("release", try_it)

    def _begin(self, payload: bytes, reply: messages.PushReply) -> None:
        request = decode(messages.ReleaseBegin, payload, SENDER)
        if request.robot_id != self._robot_id:
            raise RefusedError(
                f"the release is for robot {request.robot_id[:80]!r}, this one is "
                f"{self._robot_id!r}"
            )
        self._intake.check_free()
        manifest = self._judge(request.manifest, request.signatures)
        size_bytes = release_archive.size_bytes(
            manifest, len(request.manifest), len(request.signatures)
        )
        needed_bytes = 2 * size_bytes + manifest.installed_bytes
        ledger = read_ledger(self._application / "ledger.json")
        check_release(manifest, ledger, self._computer(), needed_bytes)
        self._inbox.mkdir(mode=0o700, parents=True, exist_ok=True)
        file = open(self._inbox / ARCHIVE, "wb", opener=_private)  # noqa: SIM115
        reply.push_id = self._intake.begin(_Push(request.manifest, file), size_bytes, file.write)

    def _commit(self, payload: bytes, reply: messages.PushReply) -> None:
        push = self._intake.take(decode(messages.PushCommit, payload, SENDER).push_id, reply)
        try:
            push.file.flush()
            os.fsync(push.file.fileno())
            with (self._inbox / ARCHIVE).open("rb") as archive:
                release_archive.read(archive, partial(self._judge_same, push.manifest))
        except (MbotError, OSError):
            self._drop(push)
            raise
        push.file.close()
        atomic_file.replace(self._inbox / REQUEST, reply.push_id.encode())
        log.info("a release has been received; the updater takes over")

    def _judge(self, manifest: bytes, signatures: bytes) -> ReleaseManifest:
        if not self._running:
            raise RefusedError(
                "this daemon does not run from an installed release: run deploy/install.sh there"
            )
        verify(RELEASE, Envelope.with_lines(manifest, signatures), self._trusted)
        found = release_manifest.decode(manifest)
        if found.version == self._running:
            raise RefusedError(f"{found.version} runs on this robot already")
        return found

    def _judge_same(self, announced: bytes, manifest: bytes, signatures: bytes) -> ReleaseManifest:
        if manifest != announced:
            raise RefusedError("the archive is another release than was announced: push again")
        return self._judge(manifest, signatures)

    def _check_standing(self) -> None:
        if self._is_armed():
            self._intake.give_up()
            raise RefusedError("the robot is armed: stop it, then update it")
        if update_goes_on(self._inbox):
            raise RefusedError("an update is under way: wait for its end")

    def _drop(self, push: _Push) -> None:
        with contextlib.suppress(OSError):  # what it could not write it need not
            push.file.close()
        atomic_file.remove(self._inbox / ARCHIVE)

    def _computer(self) -> Computer:
        try:
            system = platform.freedesktop_os_release()
        except OSError:
            system = dict[str, str]()
        return Computer(
            system.get("VERSION_CODENAME", "unknown"),
            _ARCHITECTURES.get(platform.machine(), platform.machine()),
            f"{sys.version_info.major}.{sys.version_info.minor}",
            shutil.disk_usage(self._application).free,
        )


def _private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)
