import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.errors import NewerSchemaError, RefusedError
from mbot_protocol.signing.model_manifest import ModelManifest, SignedTensor, decode, encode

MANIFEST = ModelManifest(
    robot_id="mbot-1", sequence=7, sha256="ab" * 32, size_bytes=1000, nonce="0f" * 16
)

manifests = st.builds(
    ModelManifest,
    robot_id=st.text(max_size=40),
    sequence=st.integers(1, 2**63 - 1),
    sha256=st.binary(min_size=32, max_size=32).map(bytes.hex),
    size_bytes=st.integers(1, 16 * 2**20),
    nonce=st.binary(min_size=16, max_size=16).map(bytes.hex),
    not_after_unix_s=st.integers(0, 2**63 - 1),
    allow_downgrade=st.booleans(),
    input=st.builds(SignedTensor, st.text(), st.text(), st.lists(st.integers(0, 99)).map(tuple)),
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


@given(manifests)
def test_every_manifest_is_read_back(manifest: ModelManifest) -> None:
    assert decode(encode(manifest)) == manifest


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
