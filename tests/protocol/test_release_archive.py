"""A release as a file: read by us and by tar, and refused at every changed byte."""

import io
import tarfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.signing import release_archive, release_manifest
from mbot_protocol.signing.release_manifest import ReleaseFile, ReleaseManifest

CONTENT = {"a.txt": b"hello", "deploy/install.sh": b"#!/bin/sh\n", "wheels/" + "w" * 95: b"x" * 600}


def made(folder: Path) -> bytes:
    for name, content in CONTENT.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    files = tuple(release_archive.described(folder, name) for name in sorted(CONTENT))
    manifest = ReleaseManifest("1", 1, 1, "trixie", "arm64", "3.13", 1, files)
    data = release_manifest.encode(manifest)
    out = io.BytesIO()
    release_archive.write(out, folder, data, b"signatures", files)
    assert len(out.getvalue()) == release_archive.size_bytes(manifest, len(data), 10)
    return out.getvalue()


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return made(tmp_path_factory.mktemp("release"))


def judged(data: bytes, _: bytes) -> ReleaseManifest:
    return release_manifest.decode(data)


def test_what_is_written_is_read_back(archive: bytes) -> None:
    found: dict[str, bytes] = {}

    @contextmanager
    def place(file: ReleaseFile) -> Iterator[io.BytesIO]:
        sink = io.BytesIO()
        yield sink
        found[file.path] = sink.getvalue()

    release_archive.read(io.BytesIO(archive), judged, place)
    assert found == CONTENT


def test_tar_reads_it_too(archive: bytes) -> None:
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        names = tar.getnames()
        assert names[:2] == ["manifest.json", "manifest.sig"]
        assert set(names[2:]) == set(CONTENT)
        assert tar.getmember("deploy/install.sh").mode == 0o755
        content = tar.extractfile("a.txt")
        assert content is not None
        assert content.read() == b"hello"


@settings(max_examples=300)
@given(st.data())
def test_any_changed_byte_is_noticed(archive: bytes, data: st.DataObject) -> None:
    position = data.draw(st.integers(0, len(archive) - 1))
    changed = bytearray(archive)
    changed[position] ^= data.draw(st.integers(1, 255))

    def judge(manifest: bytes, signatures: bytes) -> ReleaseManifest:
        if signatures != b"signatures" or manifest not in archive:
            raise RefusedError("the signature is not good")
        return release_manifest.decode(manifest)

    with pytest.raises(MbotError):
        release_archive.read(io.BytesIO(bytes(changed)), judge)


@pytest.mark.parametrize("change", [lambda a: a[:-1], lambda a: a + b"\0", lambda a: a[:3000]])
def test_too_short_and_too_long_are_refused(
    archive: bytes, change: Callable[[bytes], bytes]
) -> None:
    with pytest.raises(RefusedError, match="damaged"):
        release_archive.read(io.BytesIO(change(archive)), judged)


@given(st.binary(max_size=3000))
def test_anything_else_is_refused(data: bytes) -> None:
    with pytest.raises(MbotError):
        release_archive.read(io.BytesIO(data), judged)


def test_nothing_is_read_of_what_nobody_signed(archive: bytes) -> None:
    def judge(_: bytes, __: bytes) -> ReleaseManifest:
        raise RefusedError("no")

    file = io.BytesIO(archive)
    with pytest.raises(RefusedError, match="no"):
        release_archive.read(file, judge)
    assert file.tell() < 4096
