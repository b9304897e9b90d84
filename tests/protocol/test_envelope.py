"""What is signed, for models and releases; with files signed before there was one form."""

import contextlib
from dataclasses import replace
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.signing import model_manifest, release_manifest
from mbot_protocol.signing.envelope import (
    MODEL,
    RELEASE,
    Envelope,
    Purpose,
    Signature,
    sign,
    verify,
)
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.signing.release_manifest import ReleaseFile, ReleaseManifest
from mbot_workstation.fleet.models.signing_key import SigningKey

from .test_model_manifest import MANIFEST

BEFORE = Path(__file__).parents[1] / "data" / "signed"
"""A model's manifest as robots keep it, and a release's two files, signed by two keys, as they were
written by mbot-agent 0.1.0."""

# RFC 8032, section 7.1, tests 1 and 2: the secret keys, and the first one's public key.
SECRETS = (
    "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60",
    "4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb",
)
PUBLIC = bytes.fromhex("d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a")
PRIVATE = [Ed25519PrivateKey.from_private_bytes(bytes.fromhex(one)) for one in SECRETS]
KEY, SPARE = (SigningKey(one, name) for one, name in zip(PRIVATE, ("anna", "spare"), strict=True))
ANNA, BERT = PublicKey(PUBLIC, "anna"), PublicKey(bytes(32), "bert")

DATA = model_manifest.encode(MANIFEST)
SIGNED = Envelope(DATA, (KEY.sign(MODEL, DATA),))
FILE = ReleaseFile("wheels/a-1-py3-none-any.whl", 3, "0" * 64)
RELEASED = ReleaseManifest("0.2+abc", 7, 5, "trixie", "arm64", "3.13", 1000, (FILE,))


def release(*keys: SigningKey) -> Envelope:
    data = release_manifest.encode(RELEASED)
    return Envelope(data, tuple(key.sign(RELEASE, data) for key in keys))


def test_what_was_signed_before_is_taken_and_signed_the_same_today() -> None:
    kept = Envelope.from_text((BEFORE / "model.txt").read_text())
    assert verify(MODEL, kept, [BERT, ANNA]) is ANNA
    assert model_manifest.decode(kept.data) == MANIFEST
    assert kept == SIGNED
    assert SIGNED.to_text() == (BEFORE / "model.txt").read_text()
    data, lines = ((BEFORE / f"manifest.{end}").read_bytes() for end in ("json", "sig"))
    sent = Envelope.with_lines(data, lines)
    assert verify(RELEASE, sent, [KEY.public]) == KEY.public
    assert verify(RELEASE, sent, [SPARE.public]) == SPARE.public
    assert release_manifest.decode(data) == RELEASED
    assert sent == release(SPARE, KEY)
    assert "".join(one.line for one in sent.signatures).encode() == lines


@pytest.mark.parametrize(
    ("purpose", "domain"),
    [(MODEL, b"mbot-agent model manifest\0"), (RELEASE, b"mbot-agent release manifest\0")],
)
def test_a_signature_is_ed25519_over_the_bytes_in_their_domain(
    purpose: Purpose, domain: bytes
) -> None:
    signed = KEY.sign(purpose, b"these")
    assert signed.public_key == PUBLIC
    PRIVATE[0].public_key().verify(signed.signature, domain + b"these")


def test_a_signature_for_another_purpose_is_none() -> None:
    for data in (DATA, release_manifest.encode(RELEASED)):
        plain = Signature(PUBLIC, PRIVATE[0].sign(data))
        for purpose, other in ((MODEL, RELEASE), (RELEASE, MODEL)):
            for signature in (KEY.sign(other, data), plain):
                with pytest.raises(RefusedError, match="not anna's"):
                    verify(purpose, Envelope(data, (signature,)), [ANNA])
    assert not MODEL.domain.startswith(RELEASE.domain)
    assert not RELEASE.domain.startswith(MODEL.domain)


@given(st.integers(0, 8 * (len(SIGNED.data) + 64 + 32) - 1))
def test_no_bit_can_be_changed(bit: int) -> None:
    (signed,) = SIGNED.signatures
    parts = [SIGNED.data, signed.signature, signed.public_key]
    whole = bytearray(b"".join(parts))
    whole[bit // 8] ^= 1 << bit % 8
    first, second = len(parts[0]), len(parts[0]) + len(parts[1])
    changed = Signature(bytes(whole[second:]), bytes(whole[first:second]))
    with pytest.raises(RefusedError):
        verify(MODEL, Envelope(bytes(whole[:first]), (changed,)), [ANNA, BERT])


(ONE,) = SIGNED.signatures


@pytest.mark.parametrize(
    ("envelope", "words"),
    [
        (replace(SIGNED, data=b""), "manifest has 0 bytes"),
        (replace(SIGNED, data=b"x" * 2049), "manifest has 2049 bytes, expected 1 to 2048"),
        (Envelope(DATA, (Signature(PUBLIC, b""),)), "signature has 0 bytes, expected 64"),
        (Envelope(DATA, (Signature(PUBLIC, ONE.signature + b"x"),)), "signature has 65 bytes"),
        (Envelope(DATA, (Signature(b"", ONE.signature),)), "not among this robot's"),
        (Envelope(DATA, (Signature(bytes(32), ONE.signature),)), "the signature is not bert's"),
        (
            Envelope(DATA, (Signature(bytes(31) + b"\x01", ONE.signature),)),
            "signed by ed25519:AAAA.*AE=, which",
        ),
        (Envelope(DATA, ()), "signed by nobody, which"),
    ],
)
def test_what_is_wrong_is_said(envelope: Envelope, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        verify(MODEL, envelope, [ANNA, BERT])


@pytest.mark.parametrize("keys", [(KEY,), (SPARE,), (KEY, SPARE)])
def test_one_trusted_signature_is_enough(keys: tuple[SigningKey, ...]) -> None:
    found = verify(RELEASE, release(*keys), (SPARE.public, KEY.public))
    assert found == keys[0].public


def test_other_keys_changed_bytes_and_damaged_signatures_are_refused() -> None:
    with pytest.raises(RefusedError, match="not among"):
        verify(RELEASE, release(SPARE), (KEY.public,))
    with pytest.raises(RefusedError, match="not anna's"):
        verify(RELEASE, replace(release(KEY), data=b"{}"), (KEY.public,))
    with pytest.raises(RefusedError, match="trusts no key for releases"):
        verify(RELEASE, release(KEY), ())
    line = release(KEY).signatures[0].line.encode()
    for damaged in (b"x", line[:-9], b"\xff", line * 50):
        with pytest.raises(RefusedError, match="signatures are damaged"):
            Envelope.with_lines(b"{}", damaged)
    with pytest.raises(RefusedError, match="signed by nobody"):
        verify(RELEASE, Envelope.with_lines(b"{}", b""), (KEY.public,))


@given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
def test_garbage_is_refused_but_never_crashes(data: bytes) -> None:
    with contextlib.suppress(MbotError):
        Envelope.from_text(data.decode(errors="replace"))
    with contextlib.suppress(MbotError):
        Envelope.with_lines(data, data)
    for purpose in (MODEL, RELEASE):
        with pytest.raises(RefusedError):
            verify(purpose, Envelope(data, (Signature(data, data),)), [ANNA])


def test_what_signs_is_not_asked_for_more_than_the_bytes() -> None:
    asked: list[bytes] = []
    sign(RELEASE, b"data", lambda message: asked.append(message) or bytes(64), PUBLIC)
    assert asked == [RELEASE.domain + b"data"]
