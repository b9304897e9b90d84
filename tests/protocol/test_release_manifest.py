"""The manifest of a release: one form, signed by one of several keys."""

import json
from dataclasses import asdict, replace

import pytest

from mbot_protocol.errors import MbotError, NewerSchemaError, RefusedError
from mbot_protocol.signing import release_manifest
from mbot_protocol.signing.release_manifest import ReleaseFile, ReleaseManifest, decode, encode

FILE = ReleaseFile("wheels/a-1-py3-none-any.whl", 3, "0" * 64)
GOOD = ReleaseManifest("0.2+abc", 7, 5, "trixie", "arm64", "3.13", 1000, (FILE,))


def test_what_is_encoded_is_read_back() -> None:
    assert decode(encode(GOOD)) == GOOD


@pytest.mark.parametrize(
    "change",
    [
        {"version": "../x"},
        {"version": ""},
        {"sequence": -1},
        {"sequence": True},
        {"floor": "1"},
        {"installed_bytes": 2**63},
        {"python": 3},
        {"files": []},
        {"files": [asdict(FILE), asdict(FILE)]},
        {"files": [asdict(FILE) | {"path": "../etc/passwd"}]},
        {"files": [asdict(FILE) | {"path": "/etc/passwd"}]},
        {"files": [asdict(FILE) | {"path": "a/./b"}]},
        {"files": [asdict(FILE) | {"sha256": "g" * 64}]},
        {"files": [asdict(FILE) | {"size_bytes": -1}]},
        {"files": [asdict(FILE) | {"more": 1}]},
        {"files": 3},
        {"more": 1},
    ],
)
def test_what_is_out_of_range_is_refused(change: dict[str, object]) -> None:
    data = json.dumps(asdict(GOOD) | change, sort_keys=True, separators=(",", ":")).encode()
    with pytest.raises(RefusedError):
        decode(data)


@pytest.mark.parametrize(
    "data", [b"", b"[]", b"3", b"\xff", b"{}", encode(GOOD) + b" ", b"[" * 9999]
)
def test_what_is_no_manifest_is_refused(data: bytes) -> None:
    with pytest.raises(RefusedError):
        decode(data)


def test_a_newer_format_is_named() -> None:
    with pytest.raises(NewerSchemaError, match="format 2"):
        decode(encode(replace(GOOD, format=2)))


def test_refusals_are_for_people() -> None:
    with pytest.raises(MbotError) as error:
        release_manifest.check_version("a b")
    assert len(str(error.value).splitlines()) == 1
