"""Signatures as Python's own OpenSSL checks them, held to the package `cryptography`."""

import subprocess
import sys

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol import ed25519
from mbot_protocol.ed25519 import by_cryptography, by_openssl, is_genuine

# RFC 8032, section 7.1, tests 1 to 3: public key, message, signature.
VECTORS = [
    (
        "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a",
        "",
        "e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555"
        "fb8821590a33bacc61e39701cf9b46bd25bf5f0595bbe24655141438e7a100b",
    ),
    (
        "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c",
        "72",
        "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da0"
        "85ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00",
    ),
    (
        "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025",
        "af82",
        "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac1"
        "8ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a",
    ),
]
GROUP_ORDER = 2**252 + 27742317777372353535851937790883648493

keys = st.binary(min_size=32, max_size=32).map(Ed25519PrivateKey.from_private_bytes)


def public(key: Ed25519PrivateKey) -> bytes:
    return key.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)


@pytest.mark.parametrize(("key", "message", "signature"), VECTORS)
def test_the_standards_examples(key: str, message: str, signature: str) -> None:
    raw, text, signed = (bytes.fromhex(part) for part in (key, message, signature))
    assert is_genuine(raw, signed, text)
    assert not is_genuine(raw, signed, text + b"x")


def test_pythons_own_openssl_is_what_checks_here() -> None:
    """Otherwise the tests below would compare `cryptography` with itself."""
    assert by_openssl() is not None


@given(keys, st.binary(max_size=200), st.integers(0, 511), st.integers(0, 255))
def test_both_checkers_agree(
    key: Ed25519PrivateKey, message: bytes, signature_bit: int, key_bit: int
) -> None:
    by_python = by_openssl()
    assert by_python is not None
    signature = key.sign(message)
    flipped = flip(signature, signature_bit)
    for raw, signed, text, genuine in (
        (public(key), signature, message, True),
        (public(key), flipped, message, False),
        (public(key), signature, message + b"\0", False),
        (flip(public(key), key_bit), signature, message, False),
    ):
        assert by_python(raw, signed, text) == by_cryptography(raw, signed, text) == genuine


@given(st.binary(min_size=32, max_size=32), st.binary(min_size=64, max_size=64))
def test_both_agree_on_bytes_that_are_no_keys_and_no_signatures(
    raw: bytes, signature: bytes
) -> None:
    assert is_genuine(raw, signature, b"message") == by_cryptography(raw, signature, b"message")


@given(keys)
def test_a_signature_has_one_form_only(key: Ed25519PrivateKey) -> None:
    """Its second half plus the group's order solves the equation too; the standard forbids it."""
    signature = key.sign(b"message")
    scalar = int.from_bytes(signature[32:], "little") + GROUP_ORDER
    assert not is_genuine(public(key), signature[:32] + scalar.to_bytes(32, "little"), b"message")


@pytest.mark.parametrize(("key_bytes", "signature_bytes"), [(0, 64), (31, 64), (33, 64), (32, 63)])
def test_other_sizes_are_no_signatures(key_bytes: int, signature_bytes: int) -> None:
    assert not is_genuine(bytes(key_bytes), bytes(signature_bytes), b"")


def test_a_python_without_a_shared_openssl_asks_cryptography(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr("_hashlib.__file__")
    ed25519._checker.cache_clear()  # pyright: ignore[reportPrivateUsage]
    try:
        assert by_openssl() is None
        test_the_standards_examples(*VECTORS[1])
    finally:
        ed25519._checker.cache_clear()  # pyright: ignore[reportPrivateUsage]


def test_checking_loads_no_second_openssl() -> None:
    key, message, signature = VECTORS[1]
    program = f"""
import sys
from mbot_protocol.ed25519 import is_genuine
h = bytes.fromhex
assert is_genuine(h({key!r}), h({signature!r}), h({message!r}))
assert "cryptography" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def flip(data: bytes, bit: int) -> bytes:
    """With one bit the other way round."""
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
