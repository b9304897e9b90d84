"""The manifest of a release: one form, signed by one of several keys."""

import json
from dataclasses import asdict, replace

import pytest

from mbot_protocol.errors import MbotError, NewerSchemaError, RefusedError
from mbot_protocol.signing import release_manifest
from mbot_protocol.signing.release_manifest import ReleaseFile, ReleaseManifest, decode, encode
from mbot_workstation.fleet.models.signing_key import SigningKey

FILE = ReleaseFile("wheels/a-1-py3-none-any.whl", 3, "0" * 64)
GOOD = ReleaseManifest("0.2+abc", 7, 5, "trixie", "arm64", "3.13", 1000, (FILE,))
KEY, SPARE = SigningKey.ephemeral("first"), SigningKey.ephemeral("spare")


def signed(*keys: SigningKey) -> bytes:
    data = encode(GOOD)
    return "".join(
        release_manifest.sign(data, key.sign_bytes, key.public.raw) for key in keys
    ).encode()


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


@pytest.mark.parametrize("keys", [(KEY,), (SPARE,), (KEY, SPARE)])
def test_one_trusted_signature_is_enough(keys: tuple[SigningKey, ...]) -> None:
    trusted = (SPARE.public, KEY.public)
    found = release_manifest.verify(encode(GOOD), signed(*keys), trusted)
    assert found == keys[0].public


def test_other_keys_changed_bytes_and_damaged_signatures_are_refused() -> None:
    data = encode(GOOD)
    with pytest.raises(RefusedError, match="not among"):
        release_manifest.verify(data, signed(SPARE), (KEY.public,))
    with pytest.raises(RefusedError, match="not first's"):
        release_manifest.verify(data + b" ", signed(KEY), (KEY.public,))
    with pytest.raises(RefusedError, match="trusts no key"):
        release_manifest.verify(data, signed(KEY), ())
    for damaged in (b"", b"x", signed(KEY)[:-9], b"\xff", signed(KEY) * 50):
        with pytest.raises(RefusedError):
            release_manifest.verify(data, damaged, (KEY.public,))


def test_a_models_signature_is_none_under_a_release() -> None:
    from mbot_protocol.signing import model_manifest

    domain = model_manifest._DOMAIN  # pyright: ignore[reportPrivateUsage]
    assert domain != release_manifest._DOMAIN  # pyright: ignore[reportPrivateUsage]
    assert not domain.startswith(release_manifest._DOMAIN)  # pyright: ignore[reportPrivateUsage]


def test_refusals_are_for_people() -> None:
    with pytest.raises(MbotError) as error:
        release_manifest.check_version("a b")
    assert len(str(error.value).splitlines()) == 1
