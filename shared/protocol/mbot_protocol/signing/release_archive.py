"""A release as one file: an uncompressed tar that has one form only.

`manifest.json`, `manifest.sig`, then the files as the manifest lists them. Nothing is parsed but
the length of the first two: each header must be, byte for byte, the one that the signed manifest
leads to. So a hostile archive has nothing to say, and `tar` can read it all the same.
Standard library only.
"""

import hashlib
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import IO, Protocol

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.envelope import LARGEST_SIGNATURES_BYTES, RELEASE
from mbot_protocol.signing.release_manifest import (
    LARGEST_RELEASE_BYTES,
    ReleaseFile,
    ReleaseManifest,
)

MANIFEST, SIGNATURES = "manifest.json", "manifest.sig"

_BLOCK = 512
_PIECE_BYTES = 1 << 20
_END = bytes(2 * _BLOCK)
_DAMAGED = "the archive is damaged or no release: fetch or build it again"


class Sink(Protocol):
    """Where a file's bytes go."""

    def write(self, data: bytes, /) -> object:
        """Take the next ones."""
        ...


Judge = Callable[[bytes, bytes], ReleaseManifest]
"""From the manifest's bytes and its signatures' to what may go on; raises RefusedError."""

Place = Callable[[ReleaseFile], AbstractContextManager[Sink | None]]
"""Where a file goes; None: it is only verified."""


def nowhere(_: ReleaseFile) -> AbstractContextManager[Sink | None]:
    """Verify only."""
    return nullcontext()


def size_bytes(manifest: ReleaseManifest, manifest_bytes: int, signatures_bytes: int) -> int:
    """Length of the whole archive."""
    sizes = [manifest_bytes, signatures_bytes, *(file.size_bytes for file in manifest.files)]
    return sum(_BLOCK + size + _padding(size) for size in sizes) + len(_END)


def read(archive: IO[bytes], judge: Judge, place: Place = nowhere) -> ReleaseManifest:
    """Read and verify an archive, file by file, without holding one in memory.

    Raises:
        RefusedError: `judge` said so, a byte is another than the manifest says, or it is too short
            or too long. What has gone to sinks until then is worth nothing.
        OSError: the archive can't be read, or a sink can't take it.

    """
    data = _leading(archive, MANIFEST, RELEASE.largest_bytes)
    signatures = _leading(archive, SIGNATURES, LARGEST_SIGNATURES_BYTES)
    manifest = judge(data, signatures)
    if size_bytes(manifest, len(data), len(signatures)) > LARGEST_RELEASE_BYTES:
        raise RefusedError(f"the release is larger than {LARGEST_RELEASE_BYTES >> 20} MiB")
    for file in manifest.files:
        _expect(archive, _header(file.path, file.size_bytes))
        with place(file) as sink:
            _copy(archive, file, sink)
        _expect(archive, bytes(_padding(file.size_bytes)))
    _expect(archive, _END)
    if archive.read(1):
        raise RefusedError(_DAMAGED)
    return manifest


def write(
    archive: IO[bytes], folder: Path, data: bytes, signatures: bytes, files: Iterable[ReleaseFile]
) -> None:
    """Write a release whose files lie in `folder`."""
    for name, content in ((MANIFEST, data), (SIGNATURES, signatures)):
        archive.write(_header(name, len(content)) + content + bytes(_padding(len(content))))
    for file in files:
        archive.write(_header(file.path, file.size_bytes))
        with (folder / file.path).open("rb") as content:
            while piece := content.read(_PIECE_BYTES):
                archive.write(piece)
        archive.write(bytes(_padding(file.size_bytes)))
    archive.write(_END)


def described(folder: Path, path: str) -> ReleaseFile:
    """A file as the manifest lists it."""
    digest, size = hashlib.sha256(), 0
    with (folder / path).open("rb") as content:
        while piece := content.read(_PIECE_BYTES):
            digest.update(piece)
            size += len(piece)
    return ReleaseFile(path, size, digest.hexdigest())


def _leading(archive: IO[bytes], name: str, most_bytes: int) -> bytes:
    header = archive.read(_BLOCK)
    try:
        size = int(header[124:135], 8)
    except ValueError:
        size = -1
    if not 0 <= size <= most_bytes or header != _header(name, size):
        raise RefusedError(_DAMAGED)
    content = archive.read(size)
    if len(content) != size:
        raise RefusedError(_DAMAGED)
    _expect(archive, bytes(_padding(size)))
    return content


def _copy(archive: IO[bytes], file: ReleaseFile, sink: Sink | None) -> None:
    digest, rest = hashlib.sha256(), file.size_bytes
    while rest:
        piece = archive.read(min(rest, _PIECE_BYTES))
        if not piece:
            raise RefusedError(_DAMAGED)
        digest.update(piece)
        rest -= len(piece)
        if sink is not None:
            sink.write(piece)
    if digest.hexdigest() != file.sha256:
        raise RefusedError(f"{file.path} in the archive is damaged: fetch or build it again")


def _expect(archive: IO[bytes], expected: bytes) -> None:
    if archive.read(len(expected)) != expected:
        raise RefusedError(_DAMAGED)


def _padding(size: int) -> int:
    return -size % _BLOCK


def _header(path: str, size: int) -> bytes:
    """A ustar header (POSIX.1-1988): root's, readable by all, without a date."""
    name, prefix = path.encode(), b""
    if len(name) > 100:
        parent, _, last = path.rpartition("/")
        prefix, name = parent.encode(), last.encode()
    if len(name) > 100 or len(prefix) > 155:
        raise RefusedError(f"the path {path[:80]!r}... is too long for a release")
    mode = b"0000755\0" if path.endswith(".sh") else b"0000644\0"
    numbers = mode + b"0000000\0" * 2 + b"%011o\0" % size + b"00000000000\0"
    tail = (
        b"0" + bytes(100) + b"ustar\x0000" + bytes(64) + b"0000000\0" * 2 + prefix.ljust(155, b"\0")
    )
    block = name.ljust(100, b"\0") + numbers + b" " * 8 + tail
    block = block.ljust(_BLOCK, b"\0")
    return block[:148] + b"%06o\0 " % sum(block) + block[156:]
