"""One file of a recording: MCAP, in small chunks that reach the card one by one.

What a power cut leaves is whole up to the last chunk that was synced. Schemas and channels also
stand before the first chunk, so that damage there costs that chunk only.
"""

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.changes import changes
from mbot_protocol.beat.channels import (
    DECISION_TOPIC,
    DRIVE_TOPIC,
    LOG_TOPIC,
    OBSERVATION_TOPIC,
    ROBOT_METADATA,
    RobotFacts,
    topic,
)
from mbot_protocol.beat.fields import DRIVE_SCHEMA_NAME, drive_numbers, drive_schema
from mbot_protocol.v1.messages_pb2 import Decision

LARGEST_CHUNK_BYTES = 1 << 20
"""At 20 beats a second a second's chunk is a quarter of that."""

SYNC_AFTER_S = 0.8
"""From a chunk's first message to its sync. With the time that this takes it stays below a
second."""

_LEVELS = {"INFO": Log.INFO, "WARN": Log.WARNING, "ERROR": Log.ERROR}


class BeatWriter:
    """A file being written. Not for several threads.

    Topics are `/mbot/ID/` and `decision` (mbot.v1.Decision), `drive` (the same as JSON, which every
    viewer plots), `observation` (foxglove.CompressedImage) and `log` (foxglove.Log: what changes,
    in words). Times are the robot's wall clock.
    """

    def __init__(
        self,
        path: Path,
        robot_id: str,
        library: str,
        facts: RobotFacts | None = None,
        *,
        before: Decision | None = None,
        compression: CompressionType = CompressionType.NONE,
        sync_after_s: float = SYNC_AFTER_S,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the file.

        Args:
            path: of a new file.
            robot_id: whose beats.
            library: who writes, with the version.
            facts: what a replay needs to know of the robot; telemetry does not tell.
            before: the beat before the first one, in another file of the same drive.
            compression: of chunks; whatever compresses must be installed.
            sync_after_s: how long a message may stay in memory only.
            monotonic_s: the time, for the next sync.

        Raises:
            OSError: it exists, or cannot be written; then there is none.

        """
        self._robot_id = robot_id
        self._sync_after_s, self._monotonic_s = sync_after_s, monotonic_s
        self._unsynced_s: float | None = None
        self._before = before
        self._file = path.open("xb")
        try:
            self._writer = Writer(
                self._file, LARGEST_CHUNK_BYTES, compression, enable_data_crcs=False
            )
            self._writer.start(library=library)
            if facts is not None:
                self._writer.add_metadata(ROBOT_METADATA, facts.to_strings())
            self._ahead = RecordBuilder()
            self._decisions = self._register_protobuf(DECISION_TOPIC, Decision)
            self._pictures = self._register_protobuf(OBSERVATION_TOPIC, CompressedImage)
            self._log = self._register_protobuf(LOG_TOPIC, Log)
            self._drives = self._register(
                DRIVE_TOPIC,
                MessageEncoding.JSON,
                Schema(0, drive_schema(), SchemaEncoding.JSONSchema, DRIVE_SCHEMA_NAME),
            )
            self._file.write(self._ahead.end())
            _sync_directory(path.parent)
            self.sync()
        except BaseException:
            self.abandon()
            with contextlib.suppress(OSError):
                path.unlink()
            raise

    def write(self, beat: Beat) -> None:
        """Add one beat: its decision, the same as JSON, what it saw, and what is new in words."""
        decision, time_ns = beat.decision, beat.decision.unix_time_ns
        sequence = decision.sequence % 2**32
        for level, words in changes(self._before, decision, beat.last_stop):
            line = Log(level=_LEVELS[level], message=words, name=self._robot_id)
            line.timestamp.FromNanoseconds(time_ns)
            self._add(self._log, time_ns, line.SerializeToString())
        self._before = decision
        if beat.encoded:
            self.write_picture(beat.encoded, "png" if beat.is_exact else "jpeg", time_ns)
        self._add(self._decisions, time_ns, decision.SerializeToString(), sequence)
        numbers = msgspec.json.encode(drive_numbers(decision, beat.policy_input))
        self._add(self._drives, time_ns, numbers, sequence)

    def write_picture(self, encoded: bytes, kind: str, time_ns: int) -> None:
        """Add what the policy saw: "png", which is lossless, or "jpeg"."""
        message = CompressedImage(frame_id=self._robot_id, format=kind, data=encoded)
        message.timestamp.FromNanoseconds(time_ns)
        self._add(self._pictures, time_ns, message.SerializeToString())

    @property
    def due_in_s(self) -> float | None:
        """How long until the next sync; None: there is nothing to sync."""
        if self._unsynced_s is None:
            return None
        return max(0.0, self._unsynced_s + self._sync_after_s - self._monotonic_s())

    def sync(self) -> None:
        """End the chunk and wait until it has reached the card.

        Raises:
            OSError: it has not.

        """
        self._writer.flush()
        os.fsync(self._file.fileno())
        self._unsynced_s = None

    def close(self) -> None:
        """End the file properly, with its index; raises as `sync`."""
        try:
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Let go of the file as it is; what was synced can be read."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _add(self, channel: int, time_ns: int, data: bytes, sequence: int = 0) -> None:
        if self._unsynced_s is None:
            self._unsynced_s = self._monotonic_s()
        self._writer.add_message(channel, max(0, time_ns), data, max(0, time_ns), sequence)

    def _register_protobuf(self, name: str, kind: type[Message]) -> int:
        descriptors = build_file_descriptor_set(kind).SerializeToString()
        full_name = kind.DESCRIPTOR.full_name
        schema = Schema(0, descriptors, SchemaEncoding.Protobuf, full_name)
        return self._register(name, MessageEncoding.Protobuf, schema)

    def _register(self, name: str, encoding: str, schema: Schema) -> int:
        schema.id = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        full_topic = topic(self._robot_id, name)
        channel_id = self._writer.register_channel(full_topic, encoding, schema.id)
        schema.write(self._ahead)
        Channel(channel_id, full_topic, encoding, {}, schema.id).write(self._ahead)
        return channel_id


def _sync_directory(folder: Path) -> None:
    directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
