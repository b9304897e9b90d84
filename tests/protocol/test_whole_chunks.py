"""The reader of recordings on files that were cut off and damaged in every way."""

import random
import struct
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from mbot_protocol.beat import whole_chunks
from mbot_protocol.beat.whole_chunks import MOST_CHUNK_BYTES, MOST_RECORDS, WholeChunks
from mbot_protocol.errors import ConfigurationError


def a_file(
    path: Path,
    chunks: int,
    size: int,
    *,
    finished: bool = True,
    compression: CompressionType = CompressionType.NONE,
) -> list[int]:
    """Two messages a chunk, numbered in their time; the file's size after each chunk."""
    noise, ends = random.Random(chunks), list[int]()
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        writer.add_metadata("who", {"robot": "mbot-1"})
        schema = writer.register_schema("numbers", "jsonschema", b"{}")
        channel = writer.register_channel("/numbers", "json", schema)
        for index in range(chunks):
            for half in range(2):
                writer.add_message(channel, 2 * index + half, noise.randbytes(size), 0)
            writer.flush()
            ends.append(file.tell())
        if finished:
            writer.finish()
    return ends


def numbers(chunks: WholeChunks) -> list[int]:
    return [message.log_time_ns for message in chunks.messages()]


@pytest.mark.parametrize("compression", CompressionType)
def test_a_whole_file_is_read_whole(tmp_path: Path, compression: CompressionType) -> None:
    path = tmp_path / "drive.mcap"
    a_file(path, 5, 300, compression=compression)
    chunks = WholeChunks(path)
    (first, *_) = chunks.messages()
    assert (first.topic, first.schema, len(first.data)) == ("/numbers", "numbers", 300)
    assert numbers(chunks) == list(range(10))
    assert chunks.words == "5 of 5 chunks read"
    assert chunks.is_whole
    assert chunks.metadata == {"who": {"robot": "mbot-1"}}


def test_cut_at_every_byte_all_chunks_before_are_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    ends = a_file(path, 4, 40)
    data = path.read_bytes()
    assert len(data) > 1000
    for size in range(len(data)):
        path.write_bytes(data[:size])
        chunks = WholeChunks(path)
        found = numbers(chunks)
        # A chunk is followed by its index, which nobody needs.
        assert found == list(range(len(found)))
        assert chunks.chunks_read == len(found) // 2 >= sum(end <= size for end in ends)
        assert chunks.chunks_read <= chunks.chunks_found <= chunks.chunks_read + 1
        assert not chunks.is_whole


def test_cut_at_a_thousand_places_all_chunks_before_are_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    ends = a_file(path, 80, 400, finished=False)
    data = path.read_bytes()
    noise = random.Random(7)
    for _ in range(1000):
        size = noise.randrange(len(data))
        path.write_bytes(data[:size])
        chunks = WholeChunks(path)
        found = numbers(chunks)
        assert found == list(range(len(found)))
        assert len(found) // 2 >= sum(end <= size for end in ends)
        assert chunks.words.startswith(f"{len(found) // 2} of ")


@pytest.mark.parametrize("compression", CompressionType)
def test_a_flipped_bit_costs_one_chunk_at_most(
    tmp_path: Path, compression: CompressionType
) -> None:
    path = tmp_path / "drive.mcap"
    a_file(path, 20, 200, compression=compression)
    data = path.read_bytes()
    noise = random.Random(11)
    # The first chunk names the channel; a file without it keeps nothing but its index to go by.
    begin = data.index(b"\x06", 100)
    for _ in range(1000):
        damaged = bytearray(data)
        damaged[noise.randrange(begin, len(data))] ^= 1 << noise.randrange(8)
        path.write_bytes(damaged)
        chunks = WholeChunks(path)
        found = numbers(chunks)
        assert sorted(set(found)) == found
        assert chunks.chunks_read == len(found) // 2 >= 19
        assert chunks.chunks_found == 20 or chunks.chunks_read == 20


def test_many_flipped_bits_are_no_exception_and_nothing_wrong_is_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    a_file(path, 40, 200)
    data = path.read_bytes()
    whole = {(m.log_time_ns, m.data) for m in WholeChunks(path).messages()}
    noise = random.Random(13)
    for _ in range(300):
        damaged = bytearray(data)
        for _ in range(30):
            damaged[noise.randrange(8, len(data))] ^= 1 << noise.randrange(8)
        path.write_bytes(damaged)
        chunks = WholeChunks(path)
        assert {(m.log_time_ns, m.data) for m in chunks.messages()} <= whole
        assert chunks.chunks_read <= chunks.chunks_found


def repacked(path: Path, compression: str, data: bytes, says: int) -> None:
    """A file of one chunk that says that it is so large once unpacked."""
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 0, says, 0, len(name)) + name + struct.pack("<Q", len(data))
    record = struct.pack("<BQ", 6, len(body) + len(data)) + body + data
    path.write_bytes(MCAP0_MAGIC + record)


@pytest.mark.parametrize(
    ("compression", "pack"), [("zstd", zstandard.compress), ("lz4", lz4.frame.compress)]
)
@pytest.mark.parametrize("says", [1000, MOST_CHUNK_BYTES, 400_000_000, 1 << 40, (1 << 64) - 1])
def test_a_chunk_is_unpacked_only_as_far_as_it_says_and_may(
    tmp_path: Path, compression: str, pack: Callable[[bytes], bytes], says: int
) -> None:
    """Whatever it says: the content has 400 MB, in 40 kB or 1.6 MB."""
    path = tmp_path / "bomb.mcap"
    repacked(path, compression, pack(bytes(400_000_000)), says)
    chunks = WholeChunks(path)
    tracemalloc.start()
    assert numbers(chunks) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 3 * MOST_CHUNK_BYTES
    assert chunks.words.startswith("0 of 1")


def test_messages_without_chunks_are_read(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        channel = writer.register_channel("/n", "json", writer.register_schema("n", "", b""))
        for number in range(9):
            writer.add_message(channel, number, b"x" * number, 0)
        writer.finish()
    chunks = WholeChunks(path)
    assert numbers(chunks) == list(range(9))
    assert chunks.is_whole
    data = path.read_bytes()
    for size in range(0, len(data), 7):
        path.write_bytes(data[:size])
        found = numbers(WholeChunks(path))
        assert found == list(range(len(found)))


def test_what_is_none_is_told(tmp_path: Path) -> None:
    path = tmp_path / "notes.mcap"
    path.write_text("Dear diary, today the robot drove.")
    with pytest.raises(ConfigurationError, match="not an MCAP recording"):
        WholeChunks(path)
    with pytest.raises(ConfigurationError, match="No such file"):
        WholeChunks(tmp_path / "none.mcap")
    path.write_bytes(MCAP0_MAGIC[:3])
    assert WholeChunks(path).words == "0 of 0 chunks read, it was never ended properly"


def test_chunks_that_unpack_to_too_much_together_are_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "six.mcap"
    path.write_bytes(bytes((6,)) * (20 << 20))
    began_s = time.monotonic()
    with pytest.raises(ConfigurationError, match="not an MCAP"):
        WholeChunks(path)
    assert time.monotonic() - began_s < 10, "looked for by its shape, not byte by byte: was 36 s"
    monkeypatch.setattr(whole_chunks, "MOST_BYTES", 10)
    recorded = WholeChunks(Path(__file__).parents[1] / "data" / "recorded-drive" / "000.mcap")
    with pytest.raises(ConfigurationError, match="unpacks to more than"):
        list(recorded.messages())


EMPTY_MESSAGE = struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 0)
PRIVATE_RECORD = struct.pack("<BQ", 0x90, 0)


@pytest.mark.parametrize("record", [EMPTY_MESSAGE, PRIVATE_RECORD])
def test_records_without_end_are_refused_in_one_line(tmp_path: Path, record: bytes) -> None:
    """Two million that weigh nothing, in 6 kB."""
    path = tmp_path / "bomb.mcap"
    content = record * 2_000_000
    repacked(path, "zstd", zstandard.compress(content), len(content))
    with pytest.raises(ConfigurationError, match=f"more than {MOST_RECORDS:,} records"):
        list(WholeChunks(path).messages())


def test_records_without_chunks_are_counted_as_well(tmp_path: Path) -> None:
    path = tmp_path / "loose.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        channel = writer.register_channel("/n", "json", writer.register_schema("n", "", b""))
        for number in range(3):
            writer.add_message(channel, number, b"", 0)
        writer.finish()
    assert len(list(WholeChunks(path).messages(3))) == 3
    with pytest.raises(ConfigurationError, match="more than 2 records"):
        list(WholeChunks(path).messages(2))
