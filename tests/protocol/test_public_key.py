import base64

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.public_key import PublicKey

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
        ("", "is no signing key"),
        ("ssh-ed25519 AAAAC3NzaC1lZDI1NTE5 anna@home", "is no signing key"),
        (LINE.replace("ed25519:", "rsa:"), "is no signing key"),
        (f"ed25519:{base64.b64encode(RAW[:31]).decode()} anna", "is no signing key"),
        (f"ed25519:{base64.b64encode(RAW + b'x').decode()} anna", "is no signing key"),
        (LINE.removesuffix(" anna"), "the key's name is ''"),
        (LINE.replace(" anna", " ../anna"), "the key's name"),
        (LINE.replace(" anna", " anna's key"), "the key's name"),
    ],
)
def test_a_mistake_is_named(line: str, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        PublicKey.parse(line)
