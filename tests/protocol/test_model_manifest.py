import contextlib
from dataclasses import replace

import msgspec
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import MbotError, NewerSchemaError, RefusedError
from mbot_protocol.signing.model_manifest import (
    LARGEST_MANIFEST_BYTES,
    ModelManifest,
    SignedManifest,
    Tensor,
    decode,
    encode,
    sign,
    verify,
)
from mbot_protocol.signing.public_key import PublicKey

# RFC 8032, section 7.1, test 1: the secret key, and the public key that belongs to it.
SECRET = bytes.fromhex("9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60")
PUBLIC = bytes.fromhex("d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a")

KEY = Ed25519PrivateKey.from_private_bytes(SECRET)
ANNA = PublicKey(PUBLIC, "anna")
BERT = PublicKey(bytes(32), "bert")
MANIFEST = ModelManifest(
    robot_id="mbot-1", sequence=7, sha256="ab" * 32, size_bytes=1000, nonce="0f" * 16
)
SIGNED = sign(MANIFEST, KEY)

manifests = st.builds(
    ModelManifest,
    robot_id=st.text(max_size=40),
    sequence=st.integers(1, 2**63 - 1),
    sha256=st.binary(min_size=32, max_size=32).map(bytes.hex),
    size_bytes=st.integers(1, 16 * 2**20),
    nonce=st.binary(min_size=16, max_size=16).map(bytes.hex),
    not_after_unix_s=st.integers(0, 2**63 - 1),
    allow_downgrade=st.booleans(),
    input=st.builds(Tensor, st.text(), st.text(), st.lists(st.integers(0, 99)).map(tuple)),
)


def test_the_form_in_bytes_is_pinned() -> None:
    """A change here means that old and new software no longer understand each other."""
    assert encode(MANIFEST) == (
        b'{"robot_id":"mbot-1","sequence":7,"sha256":"' + b"ab" * 32 + b'","size_bytes":1000,'
        b'"nonce":"0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f","not_after_unix_s":0,"allow_downgrade":false,'
        b'"input":{"name":"observation","type":"uint8","shape":[1,64,64,3]},'
        b'"output":{"name":"action","type":"float32","shape":[1,2]},'
        b'"actions":"left,right in -1..1 to -250..250 motor steps","version":1}'
    )


def test_the_signature_is_ed25519_over_the_manifest_in_its_domain() -> None:
    assert SIGNED.public_key == PUBLIC
    KEY.public_key().verify(SIGNED.signature, b"mbot-agent model manifest\0" + SIGNED.manifest)


@given(manifests)
def test_every_manifest_is_read_back_and_verified(manifest: ModelManifest) -> None:
    signed = sign(manifest, KEY)
    assert decode(signed.manifest) == manifest
    if len(signed.manifest) <= LARGEST_MANIFEST_BYTES:
        assert verify(signed, [BERT, ANNA]) is ANNA
    assert SignedManifest.from_text(signed.to_text()) == signed


@given(st.integers(0, 8 * (len(SIGNED.manifest) + len(SIGNED.signature) + 32) - 1))
def test_no_bit_can_be_changed(bit: int) -> None:
    parts = [SIGNED.manifest, SIGNED.signature, SIGNED.public_key]
    whole = bytearray(b"".join(parts))
    whole[bit // 8] ^= 1 << bit % 8
    first, second = len(parts[0]), len(parts[0]) + len(parts[1])
    changed = (bytes(whole[:first]), bytes(whole[first:second]), bytes(whole[second:]))
    with pytest.raises(RefusedError):
        verify(SignedManifest(*changed), [ANNA, BERT])


@pytest.mark.parametrize(
    ("signed", "words"),
    [
        (replace(SIGNED, manifest=b""), "manifest has 0 bytes"),
        (replace(SIGNED, manifest=b"x" * 2049), "manifest has 2049 bytes, expected 1 to 2048"),
        (replace(SIGNED, signature=b""), "signature has 0 bytes, expected 64"),
        (replace(SIGNED, signature=SIGNED.signature + b"x"), "signature has 65 bytes"),
        (replace(SIGNED, public_key=b""), "not among this robot's"),
        (replace(SIGNED, public_key=bytes(32)), "the signature is not bert's"),
        (replace(SIGNED, public_key=bytes(31) + b"\x01"), "signed by ed25519:AAAA.*AE=, which"),
    ],
)
def test_what_is_wrong_is_said(signed: SignedManifest, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        verify(signed, [ANNA, BERT])


def test_a_signature_for_another_purpose_is_none_for_a_model() -> None:
    data = encode(MANIFEST)
    with pytest.raises(RefusedError, match="not anna's"):
        verify(SignedManifest(data, KEY.sign(data), PUBLIC), [ANNA])


GOOD = encode(MANIFEST)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (GOOD + b" ", "canonical"),
        (GOOD.replace(b'"sequence":7', b'"sequence":8,"sequence":7'), "canonical"),
        (GOOD.replace(b'"sequence":7', b'"sequence":07'), "unusable"),
        (GOOD.replace(b'"sequence":7', b'"sequence":7.0'), "unusable"),
        (GOOD.replace(b'"sequence":7', b'"sequence":0'), "unusable"),
        (GOOD.replace(b'"sequence":7', b'"sequence":9223372036854775808'), "unusable"),
        (GOOD.replace(b'"size_bytes":1000', b'"size_bytes":99999999'), "unusable"),
        (GOOD.replace(b'"sha256":"ab', b'"sha256":"AB'), "unusable"),
        (GOOD.replace(b'"nonce":"0f', b'"nonce":"'), "unusable"),
        (GOOD.replace(b"mbot-1", b"mbot\\u002d1"), "canonical"),
        (GOOD.replace(b'"version":1', b'"version":1,"more":2'), "unknown field"),
        (b"\xff\xfe", "unusable"),
        (b"", "unusable"),
        (b"[]", "unusable"),
    ],
)
def test_only_the_one_form_is_read(data: bytes, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        decode(data)


def test_a_newer_manifest_says_who_must_upgrade() -> None:
    newer = msgspec.json.encode({"version": 2, "something": "else"})
    with pytest.raises(NewerSchemaError, match=r"version 2.*up to 1: upgrade mbot-agent"):
        decode(newer)


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_garbage_is_refused_but_never_crashes(data: bytes) -> None:
    with contextlib.suppress(MbotError):
        decode(data)
    with contextlib.suppress(MbotError):
        SignedManifest.from_text(data.decode(errors="replace"))
    with pytest.raises(RefusedError):
        verify(SignedManifest(data, data, data), [ANNA])
