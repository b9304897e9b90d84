"""Answers `recordings/...`: lists drives, hands files out piece by piece, keeps and removes."""

from collections.abc import Callable
from typing import Protocol, TypeVar

from mbot_agent.recording.recording_directory import RecordingDirectory, StoredDrive
from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.v1 import recordings_pb2 as recordings
from mbot_protocol.wire import keys
from mbot_protocol.wire.schema import SCHEMA_VERSION, decode

MOST_LISTED = 500
"""Drives in a reply, the newest: some 50 kB."""

_SENDER = "the workstation"


class _Reply(Protocol):
    accepted: bool
    reason: str

    def SerializeToString(self) -> bytes: ...  # noqa: N802


R = TypeVar("R", bound=_Reply)


class RecordingService:
    """The replies, for one thread."""

    def __init__(self, robot_id: str, directory: RecordingDirectory, *, enabled: bool) -> None:
        self._robot_id = robot_id
        self._directory = directory
        self._enabled = enabled

    @property
    def answers(self) -> dict[str, Callable[[bytes], bytes]]:
        """What answers which key below `recordings/`."""
        return {
            keys.RECORDINGS.name: self.drives,
            keys.RECORDING_READ.name: self.read,
            keys.RECORDING_DIGEST.name: self.digest,
            keys.RECORDING_KEEP.name: self.keep,
            keys.RECORDING_REMOVE.name: self.remove,
        }

    def drives(self, _: bytes) -> bytes:
        """Reply to `recordings/list`."""
        return self._list(lambda: None)

    def read(self, payload: bytes) -> bytes:
        """Reply to `recordings/read`."""

        def act(reply: recordings.RecordingPart) -> None:
            asked = decode(recordings.RecordingRead, payload, _SENDER)
            self._check_robot(asked.robot_id)
            if not 0 < asked.count_bytes <= keys.CHUNK_BYTES:
                raise RefusedError(
                    f"count_bytes is {asked.count_bytes}, expected 1 to {keys.CHUNK_BYTES}"
                )
            if asked.offset_bytes >= 1 << 62:
                raise RefusedError(f"offset_bytes is {asked.offset_bytes}, far beyond any file")
            reply.data = self._directory.read(
                asked.drive, asked.file, asked.offset_bytes, asked.count_bytes
            )

        return _answered(recordings.RecordingPart(schema_version=SCHEMA_VERSION), act)

    def digest(self, payload: bytes) -> bytes:
        """Reply to `recordings/digest`."""

        def act(reply: recordings.RecordingDigestReply) -> None:
            asked = decode(recordings.RecordingDigest, payload, _SENDER)
            self._check_robot(asked.robot_id)
            reply.sha256 = self._directory.digest(asked.drive, asked.file, asked.size_bytes)

        return _answered(recordings.RecordingDigestReply(schema_version=SCHEMA_VERSION), act)

    def keep(self, payload: bytes) -> bytes:
        """Reply to `recordings/keep`."""

        def act() -> None:
            asked = decode(recordings.RecordingKeep, payload, _SENDER)
            self._check_robot(asked.robot_id)
            self._directory.keep(asked.drive, asked.kept)

        return self._list(act)

    def remove(self, payload: bytes) -> bytes:
        """Reply to `recordings/remove`."""

        def act() -> None:
            asked = decode(recordings.RecordingRemove, payload, _SENDER)
            self._check_robot(asked.robot_id)
            self._directory.remove(asked.drive)

        return self._list(act)

    def _list(self, act: Callable[[], None]) -> bytes:
        def act_and_list(reply: recordings.RecordingList) -> None:
            act()
            reply.enabled = self._enabled
            newest = self._directory.drives()[-MOST_LISTED:]
            reply.drives.extend(self._wire(drive) for drive in reversed(newest))
            try:
                reply.free_bytes = self._directory.free_bytes
            except OSError as error:
                raise RefusedError(f"the card does not answer: {error.strerror}") from None

        return _answered(recordings.RecordingList(schema_version=SCHEMA_VERSION), act_and_list)

    def _wire(self, drive: StoredDrive) -> recordings.ListedDrive:
        return recordings.ListedDrive(
            name=drive.name,
            files=[
                recordings.ListedFile(name=file.path.name, size_bytes=file.size_bytes)
                for file in drive.files
            ],
            started_unix_time_ns=drive.started_unix_time_ns,
            ended_unix_time_ns=drive.ended_unix_time_ns,
            kept=drive.kept,
            open=drive.name == self._directory.open_drive,
        )

    def _check_robot(self, robot_id: str) -> None:
        if robot_id != self._robot_id:
            raise RefusedError(f"this is robot {self._robot_id!r}, not {robot_id!r}")


def _answered(reply: R, act: Callable[[R], None]) -> bytes:
    try:
        act(reply)
        reply.accepted = True
    except MbotError as error:
        reply.reason = str(error)
    return reply.SerializeToString()
