"""Telemetry in an MCAP file, which Foxglove, Lichtblick and Rerun open as it is."""

import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Self

import msgspec
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import DecodeError
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from mbot_protocol.beat.drive_record import (
    DECISION_TOPIC,
    DRIVE_TOPIC,
    LOG_TOPIC,
    OBSERVATION_TOPIC,
    ROBOT_METADATA,
    SCHEMA_NAME,
    DriveRecord,
    RobotFacts,
    drive_record,
    drive_record_schema,
    topic,
)
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.recorded.beat_changes import changes
from mbot_workstation.fleet.recorded.decision_message import read_decision
from mbot_workstation.fleet.recorded.whole_chunks import WholeChunks

FLUSH_EVERY_S = 0.5
"""At most this much is lost to a power cut, plus the time to the next write: below 1 s."""

_READERS: dict[str, Callable[[bytes], Decision | CompressedImage]] = {
    Decision.DESCRIPTOR.full_name: read_decision,
    CompressedImage.DESCRIPTOR.full_name: CompressedImage.FromString,
}

_LEVELS = {"INFO": Log.INFO, "WARN": Log.WARNING, "ERROR": Log.ERROR}

_log = logging.getLogger(__name__)


class Recording:
    """Writes telemetry to a new MCAP file; a context manager, which ends the file properly.

    Topics as in a robot's own recordings: `/mbot/<id>/decision` (mbot.v1.Decision),
    `/mbot/<id>/drive` (the same as JSON, which every viewer plots), `/mbot/<id>/observation`
    (foxglove.CompressedImage), `/mbot/<id>/log` (foxglove.Log). Times are the robot's wall clock.
    """

    def __init__(
        self,
        path: Path,
        robot_id: str,
        monotonic_s: Callable[[], float] = time.monotonic,
        facts: RobotFacts | None = None,
    ) -> None:
        """Create the file.

        Args:
            path: of a new file.
            robot_id: whose telemetry.
            monotonic_s: the time, for the next save.
            facts: what a replay needs to know of the robot; telemetry does not tell.

        Raises:
            ConfigurationError: it exists already, or can't be written.

        """
        self._robot_id = robot_id
        self._before: Decision | None = None
        self._topics = {
            Decision: topic(robot_id, DECISION_TOPIC),
            CompressedImage: topic(robot_id, OBSERVATION_TOPIC),
            Log: topic(robot_id, LOG_TOPIC),
        }
        self._path = path
        self._monotonic_s = monotonic_s
        self._flushed_s = monotonic_s()
        self._pending = False
        with ExitStack() as stack:
            try:
                self._file = stack.enter_context(path.open("xb"))
            except FileExistsError:
                raise ConfigurationError(f"{path} exists already; choose another name") from None
            except OSError as error:
                raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
            try:
                self._writer = Writer(self._file)
                self._writer.start(library="mbot-workstation")
                if facts is not None:
                    self._writer.add_metadata(ROBOT_METADATA, facts.to_strings())
                self._channels = {kind: self._register(kind) for kind in self._topics}
                self._numbers = self._register_numbers()
                self._writer.flush()
                self._save()
            except OSError as error:
                path.unlink(missing_ok=True)
                raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
            self._stack = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._disk_errors(), self._stack:
            self._writer.finish()
            self._save()

    def write(self, message: Decision | CompressedImage, record: DriveRecord | None = None) -> None:
        """Add one message, and save to disk what is due.

        Args:
            message: of telemetry.
            record: a decision's numbers where more is known of them than it tells.

        Raises:
            ConfigurationError: the disk is full or gone.

        """
        if isinstance(message, Decision):
            time_ns, sequence = message.unix_time_ns, message.sequence % 2**32
        else:
            time_ns, sequence = message.timestamp.ToNanoseconds(), 0
        with self._disk_errors():
            self._add(self._channels[type(message)], time_ns, message.SerializeToString(), sequence)
            if isinstance(message, Decision):
                numbers = msgspec.json.encode(record or drive_record(message))
                self._add(self._numbers, time_ns, numbers, sequence)
                self._write_changes(message)
        self._pending = True
        self.save_if_due()

    def _write_changes(self, message: Decision) -> None:
        """Say what is new since the beat before."""
        for level, words in changes(self._before, message):
            line = Log(level=_LEVELS[level], message=words, name=self._robot_id)
            line.timestamp.FromNanoseconds(message.unix_time_ns)
            data = line.SerializeToString()
            self._add(self._channels[Log], message.unix_time_ns, data, 0)
        self._before = message

    def _add(self, channel: int, time_ns: int, data: bytes, sequence: int) -> None:
        self._writer.add_message(
            channel_id=channel,
            log_time=max(0, time_ns) or time.time_ns(),
            publish_time=max(0, time_ns),
            data=data,
            sequence=sequence,
        )

    def save_if_due(self) -> None:
        """Save to disk what came in since the last time, at most every 0.5 s.

        To be called also while nothing arrives. Raises as `write`.
        """
        now_s = self._monotonic_s()
        if self._pending and now_s - self._flushed_s >= FLUSH_EVERY_S:
            with self._disk_errors():
                self._writer.flush()
                self._save()
            self._flushed_s, self._pending = now_s, False

    def _save(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())

    @contextmanager
    def _disk_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise ConfigurationError(
                f"can't write {self._path}: {error.strerror}; what was saved can be read"
            ) from None

    def _register(self, kind: type[Decision] | type[CompressedImage] | type[Log]) -> int:
        return self._writer.register_channel(
            topic=self._topics[kind],
            message_encoding=MessageEncoding.Protobuf,
            schema_id=register_schema(self._writer, kind),
        )

    def _register_numbers(self) -> int:
        schema = self._writer.register_schema(
            SCHEMA_NAME, SchemaEncoding.JSONSchema, drive_record_schema()
        )
        name = topic(self._robot_id, DRIVE_TOPIC)
        return self._writer.register_channel(name, MessageEncoding.JSON, schema)


def read_recording(path: Path) -> Iterator[tuple[str, Decision | CompressedImage]]:
    """The messages of a recording with their topics, in the order they were written.

    A file that was cut off or damaged, as by a power cut, gives all that is whole and a warning in
    the log. Messages of other types, which another tool may have added, are left out.

    Raises:
        ConfigurationError: there is no such file, or it is not an MCAP file.

    """
    chunks, count = WholeChunks(path), 0
    for found in chunks.messages():
        read = _READERS.get(found.schema)
        if read is not None:
            try:
                message = read(found.data)
            except DecodeError:
                continue
            count += 1
            yield found.topic, message
    if not chunks.is_whole:
        _log.warning(
            "%s was cut off or damaged: %s; %d messages are whole", path, chunks.words, count
        )
