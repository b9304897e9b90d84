import base64
import subprocess
import sys

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.signing.public_key import PublicKey

RAW = bytes(range(32))
LINE = "ed25519:AAECAwQFBgcICQoLDA0ODxAREhMUFRYXGBkaGxwdHh8= anna"

names = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,47}", fullmatch=True)


def test_a_line_is_what_people_copy() -> None:
    assert PublicKey(RAW, "anna").line == LINE
    assert PublicKey.parse(f"  {LINE}\n") == PublicKey(RAW, "anna")


@given(st.binary(min_size=32, max_size=32), names)
def test_every_key_is_read_back(raw: bytes, name: str) -> None:
    assert PublicKey.parse(PublicKey(raw, name).line) == PublicKey(raw, name)


@given(st.text(max_size=80) | st.text(max_size=60).map(lambda text: f"ed25519:{text}"))
def test_other_text_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        PublicKey.parse(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("", "is not a signing key"),
        ("ssh-ed25519 AAAAC3NzaC1lZDI1NTE5 anna@home", "is not a signing key"),
        (LINE.replace("ed25519:", "rsa:"), "is not a signing key"),
        (f"ed25519:{base64.b64encode(RAW[:31]).decode()} anna", "is not a signing key"),
        (f"ed25519:{base64.b64encode(RAW + b'x').decode()} anna", "is not a signing key"),
        (LINE.removesuffix(" anna"), "the key's name is ''"),
        (LINE.replace(" anna", " ../anna"), "the key's name"),
        (LINE.replace(" anna", " anna's key"), "the key's name"),
    ],
)
def test_a_mistake_is_named(line: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        PublicKey.parse(line)


# Signatures

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

signing_keys = st.binary(min_size=32, max_size=32).map(Ed25519PrivateKey.from_private_bytes)


def public(key: Ed25519PrivateKey) -> PublicKey:
    return PublicKey(key.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw), "anna")


@pytest.mark.parametrize(("key", "message", "signature"), VECTORS)
def test_the_standards_examples(key: str, message: str, signature: str) -> None:
    raw, text, signed = (bytes.fromhex(part) for part in (key, message, signature))
    assert PublicKey(raw, "rfc").has_signed(text, signed)
    assert not PublicKey(raw, "rfc").has_signed(text + b"x", signed)


@given(signing_keys, st.binary(max_size=200), st.integers(0, 511), st.integers(0, 255))
def test_one_changed_bit_anywhere_is_no_signature(
    key: Ed25519PrivateKey, message: bytes, signature_bit: int, key_bit: int
) -> None:
    signature = key.sign(message)
    assert public(key).has_signed(message, signature)
    assert not public(key).has_signed(message + b"\0", signature)
    assert not public(key).has_signed(message, flip(signature, signature_bit))
    other = PublicKey(flip(public(key).raw, key_bit), "other")
    assert not other.has_signed(message, signature)


@given(signing_keys)
def test_a_signature_has_one_form_only(key: Ed25519PrivateKey) -> None:
    """Its second half plus the group's order solves the equation too; the standard forbids it."""
    signature = key.sign(b"message")
    scalar = int.from_bytes(signature[32:], "little") + GROUP_ORDER
    forged = signature[:32] + scalar.to_bytes(32, "little")
    assert not public(key).has_signed(b"message", forged)


@pytest.mark.parametrize(("key_bytes", "signature_bytes"), [(0, 64), (31, 64), (33, 64), (32, 63)])
def test_other_sizes_are_no_signatures(key_bytes: int, signature_bytes: int) -> None:
    assert not PublicKey(bytes(key_bytes), "odd").has_signed(b"", bytes(signature_bytes))


def test_a_key_of_small_order_signs_nothing() -> None:
    """For the neutral element as key the equation holds whatever the message is."""
    neutral = (1).to_bytes(32, "little")
    assert not PublicKey(neutral, "nobody").has_signed(b"any", neutral + bytes(32))


def test_the_robot_checks_without_the_larger_library() -> None:
    """It would take 7 MB more of a Pi's memory."""
    code = (
        "import sys, mbot_agent.daemon, mbot_agent.models.model_service\n"
        "from mbot_protocol.signing.public_key import PublicKey\n"
        "PublicKey(bytes(32), 'anna').has_signed(b'', bytes(64))\n"
        "sys.exit('cryptography' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def flip(data: bytes, bit: int) -> bytes:
    """With one bit the other way round."""
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
