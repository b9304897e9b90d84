"""One file of a recording: MCAP, in small chunks that reach the card one by one.

A chunk is a second of the drive. What a power cut leaves is whole up to the last of them. Schemas
and channels also stand before the first chunk, so that damage there costs that chunk only.
"""

import contextlib
import os
from pathlib import Path

import cv2
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import Message
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from mbot_protocol.beat.drive_record import (
    DECISION_TOPIC,
    DRIVE_TOPIC,
    LOG_TOPIC,
    OBSERVATION_TOPIC,
    ROBOT_METADATA,
    SCHEMA_NAME,
    RobotFacts,
    drive_record_schema,
    topic,
)
from mbot_protocol.drive.picture import Picture
from mbot_protocol.v1.messages_pb2 import Decision

LARGEST_CHUNK_BYTES = 1 << 20
"""At 20 beats a second a second's chunk is a quarter of that."""

PNG_EFFORT = 1
"""Of 0 to 9. Lossless either way; 9 saves a tenth and takes three times as long."""


class Segment:
    """A file being written. Not for several threads.

    Attributes:
        size_bytes: what has been handed to the disk, synced or not.

    """

    def __init__(self, path: Path, facts: RobotFacts) -> None:
        """Create the file.

        Raises:
            OSError: it exists, or cannot be written.

        """
        self._robot_id = facts.robot_id
        self._file = path.open("xb")
        try:
            self._writer = Writer(
                self._file, LARGEST_CHUNK_BYTES, CompressionType.NONE, enable_data_crcs=False
            )
            self._writer.start(library=f"mbot-agent {facts.software_version}")
            self._writer.add_metadata(ROBOT_METADATA, facts.to_strings())
            self._ahead = RecordBuilder()
            self._decisions = self._register_protobuf(DECISION_TOPIC, Decision)
            self._pictures = self._register_protobuf(OBSERVATION_TOPIC, CompressedImage)
            self._log = self._register_protobuf(LOG_TOPIC, Log)
            self._drives = self._register(
                DRIVE_TOPIC,
                MessageEncoding.JSON,
                Schema(0, drive_record_schema(), SchemaEncoding.JSONSchema, SCHEMA_NAME),
            )
            self._file.write(self._ahead.end())
            self._sync_directory(path.parent)
            self.sync()
        except BaseException:
            self.abandon()
            raise

    def write_decision(self, decision: Decision, drive_record: bytes) -> None:
        """Add one beat, as a message of ours and as plain numbers in JSON."""
        time_ns, sequence = decision.unix_time_ns, decision.sequence % 2**32
        self._add(self._decisions, time_ns, decision.SerializeToString(), sequence)
        self._add(self._drives, time_ns, drive_record, sequence)

    def write_picture(self, observation: Picture, time_ns: int) -> None:
        """Add what the policy saw, lossless: shape (64, 64, 3), uint8, RGB."""
        bgr = cv2.cvtColor(observation, cv2.COLOR_RGB2BGR)
        _, png = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, PNG_EFFORT])
        message = CompressedImage(frame_id=self._robot_id, format="png", data=png.tobytes())
        message.timestamp.FromNanoseconds(time_ns)
        self._add(self._pictures, time_ns, message.SerializeToString())

    def write_log(self, level: "Log.Level.ValueType", words: str, time_ns: int) -> None:
        """Add a line for people: a state, a fault, another model; `level` is one of Log's."""
        message = Log(level=level, message=words, name=self._robot_id)
        message.timestamp.FromNanoseconds(time_ns)
        self._add(self._log, time_ns, message.SerializeToString())

    def end_chunk(self) -> None:
        """Hand what there is to the operating system; a process that dies loses nothing of it."""
        self._writer.flush()

    def sync(self) -> None:
        """End the chunk and wait until it has reached the card.

        Raises:
            OSError: it has not.

        """
        self.end_chunk()
        os.fsync(self._file.fileno())

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

    @property
    def size_bytes(self) -> int:
        """How much there is, synced or not."""
        return self._file.tell()

    def _add(self, channel: int, time_ns: int, data: bytes, sequence: int = 0) -> None:
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

    def _sync_directory(self, folder: Path) -> None:
        directory = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
