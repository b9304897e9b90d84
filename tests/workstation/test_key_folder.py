import stat
import time
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.signing.envelope import MODEL, Envelope, verify
from mbot_protocol.signing.model_manifest import ModelManifest, encode
from mbot_protocol.signing.public_key import PublicKey
from mbot_workstation.fleet.models.key_folder import KeyFolder, keys_directory

MANIFEST = ModelManifest("mbot-1", 1, "00" * 32, 10, "00" * 16)


@pytest.fixture
def folder(tmp_path: Path) -> KeyFolder:
    return KeyFolder(tmp_path / "keys")


def never(_name: str) -> str:
    raise AssertionError("nobody should be asked for a passphrase")


def test_a_new_key_signs_what_its_public_line_verifies(folder: KeyFolder) -> None:
    line = folder.new("anna").line
    signed = folder.load("anna", never).sign(MODEL, encode(MANIFEST))
    envelope = Envelope(encode(MANIFEST), (signed,))
    assert verify(MODEL, envelope, [PublicKey.parse(line)]).name == "anna"
    assert [key.line for key in folder.public_keys()] == [line]


def test_the_private_half_is_for_its_owners_eyes_only(folder: KeyFolder) -> None:
    folder.new("anna")
    assert stat.S_IMODE((folder.path / "anna.pem").stat().st_mode) == 0o600
    assert stat.S_IMODE(folder.path.stat().st_mode) == 0o700
    (folder.path / "anna.pem").chmod(0o640)
    with pytest.raises(ConfigurationError, match="others can read the private key"):
        folder.load("anna", never)


def test_a_passphrase_is_asked_for_and_needed(folder: KeyFolder) -> None:
    folder.new("lab", "open sesame")
    assert folder.is_protected("lab")
    assert b"ENCRYPTED" in (folder.path / "lab.pem").read_bytes()
    assert folder.load("lab", lambda _name: "open sesame").public == folder.public_key("lab")
    for wrong in ("", "open barley"):
        with pytest.raises(ConfigurationError, match="passphrase is wrong"):
            folder.load("lab", lambda _name, wrong=wrong: wrong)


def test_a_key_is_never_overwritten(folder: KeyFolder) -> None:
    line = folder.new("anna").line
    with pytest.raises(ConfigurationError, match="a key 'anna' already"):
        folder.new("anna")
    assert folder.public_key("anna").line == line


def test_sequences_grow_even_if_the_clock_goes_back(
    folder: KeyFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.new("anna")
    first = folder.load("anna", never).next_sequence()
    assert abs(first - time.time_ns()) < 3600 * 10**9
    monkeypatch.setattr(time, "time_ns", lambda: 1000)
    second = folder.load("anna", never)
    assert [second.next_sequence() for _ in range(2)] == [first + 1, first + 2]


@pytest.mark.parametrize("name", ["", "../anna", "a b", ".hidden", "x" * 49, "ä"])
def test_a_name_that_is_no_file_name_is_refused(folder: KeyFolder, name: str) -> None:
    for act in (folder.new, folder.public_key):
        with pytest.raises(ConfigurationError, match="the key's name"):
            act(name)


def test_what_is_missing_or_damaged_is_named(folder: KeyFolder) -> None:
    assert folder.public_keys() == []
    with pytest.raises(ConfigurationError, match="no key 'anna' in"):
        folder.load("anna", never)
    folder.new("anna")
    (folder.path / "anna.pub").write_text("ssh-rsa AAAA")
    with pytest.raises(ConfigurationError, match=r"anna\.pub: .*is not a signing key"):
        folder.public_keys()
    (folder.path / "anna.pub").unlink()
    with pytest.raises(ConfigurationError, match="can't read"):
        folder.public_key("anna")
    (folder.path / "anna.pem").write_text("-----BEGIN PRIVATE KEY-----\nAAAA\n")
    with pytest.raises(ConfigurationError, match="it is damaged"):
        folder.load("anna", never)


def test_another_kind_of_key_is_refused(folder: KeyFolder) -> None:
    folder.new("tls")
    path = folder.path / "tls.pem"
    key = generate_private_key(SECP256R1())
    path.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    with pytest.raises(ConfigurationError, match="is not an Ed25519 key"):
        folder.load("tls", never)


def test_keys_are_where_the_users_configuration_is(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert keys_directory() == tmp_path / "mbot-agent" / "keys"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert keys_directory() == tmp_path / ".config" / "mbot-agent" / "keys"


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="cannot write to"):
        KeyFolder(tmp_path / "file" / "keys").new("anna")
