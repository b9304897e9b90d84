"""Signatures by Python's integers: what PyNaCl says, and stricter where that is lenient."""

from hypothesis import given, settings
from hypothesis import strategies as st
from nacl.signing import SigningKey

from mbot_protocol.signing.public_key import PublicKey
from mbot_update.ed25519_check import _ORDER, is_signed  # pyright: ignore[reportPrivateUsage]

# RFC 8032, 7.1, test 2.
KEY = bytes.fromhex("3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c")
SIGNATURE = bytes.fromhex(
    "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
    "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00"
)


def test_the_standards_example() -> None:
    assert is_signed(KEY, b"\x72", SIGNATURE)
    assert not is_signed(KEY, b"\x73", SIGNATURE)


@settings(max_examples=25, deadline=None)
@given(st.binary(min_size=32, max_size=32), st.binary(max_size=200))
def test_what_is_signed_is_good(seed: bytes, message: bytes) -> None:
    key = SigningKey(seed)
    assert is_signed(bytes(key.verify_key), message, key.sign(message).signature)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 95), st.integers(1, 255))
def test_any_changed_byte_is_noticed(position: int, change: int) -> None:
    data = bytearray(KEY + SIGNATURE)
    data[position] ^= change
    key, signature = bytes(data[:32]), bytes(data[32:])
    assert not is_signed(key, b"\x72", signature)
    assert not PublicKey(key, "x").has_signed(b"\x72", signature)


def test_a_second_form_of_the_same_signature_is_none() -> None:
    scalar = int.from_bytes(SIGNATURE[32:], "little") + _ORDER
    assert not is_signed(KEY, b"\x72", SIGNATURE[:32] + scalar.to_bytes(32, "little"))


def test_keys_of_small_order_and_wrong_lengths_sign_nothing() -> None:
    neutral = (1).to_bytes(32, "little")
    assert not is_signed(neutral, b"x", neutral + bytes(32))
    assert not is_signed(bytes(32), b"x", bytes(64))
    assert not is_signed(b"", b"x", SIGNATURE)
    assert not is_signed(KEY, b"\x72", SIGNATURE[:63])
