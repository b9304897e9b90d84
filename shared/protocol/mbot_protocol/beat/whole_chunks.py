"""What is whole of an MCAP file, whatever has happened to the rest.

A power cut leaves a file without index and with half a chunk at its end; a bad card flips bits or
loses blocks. Chunks carry checksums, so each is whole or left out. Where a record's length makes no
sense the next chunk is looked for by its shape; that is what `mcap recover` does not do.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame  # pyright: ignore[reportMissingTypeStubs]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.git_lfs import refuse_pointer

MOST_CHUNK_BYTES = 64 << 20
"""Writers end a chunk after 1 MB or after one message; a camera's raw picture of 4K has 25 MB."""

MOST_BYTES = 512 << 20
"""Of all chunks together, unpacked: five hours of a robot's own recording."""

MOST_RECORDS = 16 * 3600 * 10
"""Of a drive's file: sixteen hours at the paper's 2.5 beats a second, two at 20, the most that a
robot may. A beat is a decision, its numbers, a picture and now and then a line: up to 10 records a
second (docs/telemetry.md). Millions of empty ones fit into a file of some kB.
"""

_HEAD = struct.Struct("<BQ")
"""A record's opcode and the length of what follows."""

_CHUNK = struct.Struct("<QQQII")
"""First and last time, size, checksum, and how long the name of the compression is."""

_MESSAGE_HEAD = 22
"""Channel, number and two times, before a message's own bytes."""

_COUNT_AT = 22
"""Where statistics have the number of chunks: after 8, 2, 4, 4 and 4 bytes."""

_LONGEST_COMPRESSION = 8

_SHAPE = re.compile(rb"\x06(?=[\s\S]{4}\x00{4})")
"""A chunk's opcode and a length below 4 GB."""
_PRIVATE = 0x80
_BETWEEN_CHUNKS = set(Opcode) - {Opcode.CHUNK, Opcode.MESSAGE}
_FIXED_LENGTHS: dict[int, int] = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
"""Those whose place at the end could make us stop too early."""

_DAMAGE = (
    McapError,
    zstandard.ZstdError,
    zlib.error,
    struct.error,
    RuntimeError,  # lz4's
    ValueError,  # no UTF-8, no such opcode
    KeyError,
    IndexError,
    OverflowError,
    MemoryError,
    EOFError,
)
"""All that the libraries raise for bytes that are not what they should be."""


@dataclass(frozen=True, slots=True)
class McapMessage:
    """One message: its topic, its schema's full name, its encoding, its time and its bytes."""

    topic: str
    schema: str
    encoding: str
    log_time_ns: int
    data: bytes


class WholeChunks:
    """A file that was read; `messages` yields what is whole, in the order it was written.

    Attributes:
        chunks_read: how many are whole; known once `messages` has come to its end.
        chunks_found: how many there are or were, as far as that can be told.
        is_finished: whether the file was ended properly.
        metadata: its metadata records by name.

    """

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            ConfigurationError: it cannot be read, or is not an MCAP file at all.

        """
        try:
            self._data = path.read_bytes()
        except OSError as error:
            raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
        refuse_pointer(path, self._data)
        self.chunks_read = self.chunks_found = 0
        self.is_finished = False
        self.metadata: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[tuple[int, int]] = []
        self._loose: list[tuple[int, int]] = []
        self._scan()
        start = self._data[: len(MCAP0_MAGIC)]
        if not self._chunks and not self._loose and start != MCAP0_MAGIC[: len(start)]:
            raise ConfigurationError(f"{path} is not an MCAP recording")

    @property
    def words(self) -> str:
        """What could be read, such as "12 of 13 chunks read, the file was cut off"."""
        end = "" if self.is_finished else ", it was never ended properly"
        return f"{self.chunks_read} of {self.chunks_found} chunks read{end}"

    @property
    def is_whole(self) -> bool:
        """Nothing is missing; known once `messages` has come to its end."""
        return self.is_finished and self.chunks_read == self.chunks_found

    def messages(self, most: int = MOST_RECORDS) -> Iterator[McapMessage]:
        """All messages of whole chunks, and of a file without any chunk.

        Args:
            most: records of any kind that there may be.

        Raises:
            ConfigurationError: there are more, or they unpack to more than `MOST_BYTES`.

        """
        self.chunks_read = 0
        self._records, self._most = 0, most
        left_bytes = MOST_BYTES
        for start, end in self._loose:
            self._count()
            yield from self._message(Message.read(_stream(self._data[start:end]), end - start))
        for start, end in self._chunks:
            try:
                chunk = Chunk.read(_stream(self._data[start:end]))
                if chunk.uncompressed_size <= MOST_CHUNK_BYTES:  # else it is damaged, and left out
                    left_bytes -= chunk.uncompressed_size
                if left_bytes >= 0:
                    yield from self._of_chunk(chunk)
            except _DAMAGE:
                continue
            if left_bytes < 0:
                raise ConfigurationError(
                    f"the recording unpacks to more than {MOST_BYTES >> 20} MB: cut it, with `mcap "
                    "filter` for instance"
                )
            self.chunks_read += 1

    def _of_chunk(self, chunk: Chunk) -> Iterator[McapMessage]:
        """One after the other: as objects they take ten times the room of their bytes."""
        data = _unpacked(chunk)
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise ValueError("the checksum is wrong")
        stream = _stream(data)
        while stream.count < len(data):
            self._count()
            opcode, length = stream.read1(), stream.read8()
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self._channels[channel.id] = channel
            elif opcode == Opcode.MESSAGE:
                yield from self._message(Message.read(stream, length))
            else:
                stream.read(length)

    def _count(self) -> None:
        self._records += 1
        if self._records > self._most:
            raise ConfigurationError(
                f"the recording holds more than {self._most:,} records: cut it, with `mcap filter` "
                "for instance"
            )

    def _message(self, record: Message) -> Iterator[McapMessage]:
        channel = self._channels.get(record.channel_id)
        if channel is not None:
            schema = self._schemas.get(channel.schema_id)
            name = schema.name if schema is not None else ""
            encoding, time_ns = channel.message_encoding, record.log_time
            yield McapMessage(channel.topic, name, encoding, time_ns, bytes(record.data))

    def _scan(self) -> None:
        """Find the chunks, and read what stands between them."""
        data, at, counted = self._data, len(MCAP0_MAGIC), 0
        while at < len(data):
            head = data[at : at + _HEAD.size].ljust(_HEAD.size, b"\xff")
            opcode, length = _HEAD.unpack(head)
            start, end = at + _HEAD.size, at + _HEAD.size + length
            if end > len(data) or not self._makes_sense(opcode, start, end):
                # Of damage that could be anything a chunk is assumed.
                self.chunks_found += opcode not in _BETWEEN_CHUNKS
                at = self._next_chunk(at + 1)
                continue
            if opcode == Opcode.CHUNK:
                self._chunks.append((start, end))
                self.chunks_found += 1
            elif opcode == Opcode.MESSAGE:
                self._loose.append((start, end))
            elif opcode == Opcode.STATISTICS and end - start >= _COUNT_AT + 4:
                (counted,) = struct.unpack_from("<I", data, start + _COUNT_AT)
            elif opcode == Opcode.FOOTER:
                self.is_finished = data[end:] == MCAP0_MAGIC
                break
            at = end
        # The writer's own count is better than a guess, if it can be true.
        if self.is_finished and len(self._chunks) <= counted <= 2 * self.chunks_found + 1:
            self.chunks_found = counted

    def _makes_sense(self, opcode: int, start: int, end: int) -> bool:
        """Whether a record is as long as its contents say; takes up what is not a chunk."""
        data = self._data
        if opcode == Opcode.CHUNK:
            return self._is_chunk(start, end)
        if opcode == Opcode.MESSAGE:  # some writers make no chunks at all
            is_known = int.from_bytes(data[start : start + 2], "little") in self._channels
            return is_known and end - start >= _MESSAGE_HEAD and not self._chunks
        if opcode == Opcode.MESSAGE_INDEX:
            return end - start >= 6 and struct.unpack_from("<I", data, start + 2)[0] == (
                end - start - 6
            )
        if opcode in _FIXED_LENGTHS:
            return end - start == _FIXED_LENGTHS[opcode]
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
            return self._take_up(opcode, data[start:end])
        return opcode in _BETWEEN_CHUNKS or opcode >= _PRIVATE

    def _is_chunk(self, start: int, end: int) -> bool:
        """Whether the lengths inside add up to the record's."""
        size_at = start + _CHUNK.size
        if end - start < _CHUNK.size:
            return False
        name_length = _CHUNK.unpack_from(self._data, start)[4]
        if name_length > _LONGEST_COMPRESSION or size_at + name_length + 8 > end:
            return False
        (size,) = struct.unpack_from("<Q", self._data, size_at + name_length)
        return size_at + name_length + 8 + size == end

    def _next_chunk(self, at: int) -> int:
        """Where from here on something has the shape of a chunk; the data's end if nothing has."""
        data = self._data
        for found in _SHAPE.finditer(data, at):
            start = found.start() + _HEAD.size
            end = start + _HEAD.unpack_from(data, found.start())[1]
            if end <= len(data) and self._is_chunk(start, end):
                return found.start()
        return len(data)

    def _take_up(self, opcode: int, body: bytes) -> bool:
        """Keep what a record says that stands outside of chunks, if it is whole."""
        source = BytesIO(body)
        stream = ReadDataStream(source)
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas.setdefault(schema.id, schema)
            elif opcode == Opcode.CHANNEL:
                channel = Channel.read(stream)
                self._channels.setdefault(channel.id, channel)
            else:
                metadata = Metadata.read(stream)
                self.metadata[metadata.name] = metadata.metadata
        except _DAMAGE:
            return False
        return source.tell() == len(body)


def _stream(body: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def _unpacked(chunk: Chunk) -> bytes:
    """Its records, made room for only as far as it says; never for more than `MOST_CHUNK_BYTES`."""
    size = chunk.uncompressed_size
    if size > MOST_CHUNK_BYTES:
        raise ValueError(f"a chunk of {size} bytes")
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
    elif chunk.compression == "lz4":
        unpacker: Any = lz4.frame.LZ4FrameDecompressor()
        data: bytes = unpacker.decompress(chunk.data, max_length=size + 1)
    else:
        data = chunk.data
    if len(data) != size:
        raise ValueError(f"{len(data)} bytes, expected {size}")
    return data
