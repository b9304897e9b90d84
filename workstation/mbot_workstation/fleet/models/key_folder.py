"""The signing keys of this workstation's user: PEM files that nobody else can read.

`NAME.pem` is the private key (PKCS #8), `NAME.pub` its public line, `NAME.sequence` the last number
signed with it.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import read_text
from mbot_protocol.signing.public_key import PublicKey, check_key_name
from mbot_workstation.fleet.models.signing_key import SigningKey

_PROTECTED = b"ENCRYPTED PRIVATE KEY"


def keys_directory() -> Path:
    """`mbot-agent/keys` in the user's configuration."""
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "mbot-agent" / "keys"


class KeyFolder:
    """Makes, lists and loads keys."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or keys_directory()

    def new(self, name: str, passphrase: str = "") -> PublicKey:
        """Make a key; with a passphrase if one is given.

        Raises:
            ConfigurationError: the name is unfit or taken, or the folder can't be written.

        """
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
        from cryptography.hazmat.primitives.serialization import (
            BestAvailableEncryption,
            Encoding,
            NoEncryption,
            PrivateFormat,
        )

        check_key_name(name)
        private = Ed25519PrivateKey.generate()
        protection = BestAvailableEncryption(passphrase.encode()) if passphrase else NoEncryption()
        data = private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, protection)
        public = SigningKey(private, name).public
        try:
            self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._write_private(name, data)
            self._file(name, "pub").write_text(public.line + "\n")
        except FileExistsError:
            raise ConfigurationError(
                f"there is a key {name!r} already in {self.path}: choose another name"
            ) from None
        except OSError as error:
            raise ConfigurationError(f"cannot write to {self.path}: {error.strerror}") from None
        return public

    def take(self, name: str, pem: bytes) -> PublicKey:
        """Keep a key that was made elsewhere; as NAME@fleet if there is another one of that name.

        Raises:
            ConfigurationError: it is none, both names are taken, or the folder can't be written.

        """
        for free in (check_key_name(name), f"{name}@fleet"):
            path = self._file(free, "pem")
            try:
                if path.exists() and self._read_private(free) != pem:
                    continue
                public = _private_key(pem, free, None, str(path)).public
                self.path.mkdir(parents=True, exist_ok=True, mode=0o700)
                atomic_file.replace(path, pem, mode=0o600)
                self._file(free, "pub").write_text(public.line + "\n")
            except OSError as error:
                raise ConfigurationError(f"cannot write to {self.path}: {error.strerror}") from None
            return public
        raise ConfigurationError(
            f"{self.path} has other keys {name} and {name}@fleet already: move one of them away"
        )

    def pem(self, name: str) -> bytes:
        """A private key as its file has it, to be handed over; raises ConfigurationError."""
        return self._read_private(name)

    def public_keys(self) -> list[PublicKey]:
        """All keys here, by name.

        Raises:
            ConfigurationError: a public line is missing or damaged.

        """
        return [self.public_key(path.stem) for path in sorted(self.path.glob("*.pem"))]

    def public_key(self, name: str) -> PublicKey:
        """One key's public half.

        Raises:
            ConfigurationError: there is no such key, or its public line is missing or damaged.

        """
        if not self._file(check_key_name(name), "pem").is_file():
            raise ConfigurationError(
                f"no key {name!r} in {self.path}: `workstation keys list` shows those there are"
            )
        path = self._file(name, "pub")
        text = read_text(path)
        try:
            return PublicKey(PublicKey.parse(text).raw, name)
        except ConfigurationError as error:
            raise ConfigurationError(f"{path}: {error}") from None

    def is_protected(self, name: str) -> bool:
        """Whether a key has a passphrase.

        Raises:
            ConfigurationError: there is no such key, others may read it, or it can't be read.

        """
        return _PROTECTED in self._read_private(name)

    def load(self, name: str, ask_passphrase: Callable[[str], str]) -> SigningKey:
        """A key, ready to sign.

        Args:
            name: of the key.
            ask_passphrase: called with the name, only for a protected key.

        Raises:
            ConfigurationError: there is no such key, others may read it, it is damaged or no
                Ed25519 key, or the passphrase is wrong.

        """
        data = self._read_private(name)
        passphrase = ask_passphrase(name).encode() if _PROTECTED in data else None
        origin = str(self._file(name, "pem"))
        return _private_key(data, name, passphrase, origin, lambda: self._next_sequence(name))

    def _read_private(self, name: str) -> bytes:
        path = self._file(check_key_name(name), "pem")
        try:
            mode = path.stat().st_mode
            data = path.read_bytes()
        except FileNotFoundError:
            raise ConfigurationError(
                f"no key {name!r} in {self.path}: `workstation keys list` shows those there are"
            ) from None
        except OSError as error:
            raise ConfigurationError(f"cannot read {path}: {error.strerror}") from None
        if mode & 0o077:
            raise ConfigurationError(
                f"others can read the private key {path}: chmod 600 it; if they may have, make a "
                "new one and take this one out of every robot's [trust] keys"
            )
        return data

    def _write_private(self, name: str, data: bytes) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        with os.fdopen(os.open(self._file(name, "pem"), flags, 0o600), "wb") as file:
            file.write(data)

    def _next_sequence(self, name: str) -> int:
        """The time, unless the clock has been set back since the last push."""
        path = self._file(name, "sequence")
        try:
            last = int(path.read_text())
        except (OSError, ValueError):
            last = 0
        sequence = max(time.time_ns(), last + 1)
        try:
            atomic_file.replace(path, f"{sequence}\n".encode())
        except OSError as error:
            raise ConfigurationError(f"cannot write {path}: {error.strerror}") from None
        return sequence

    def _file(self, name: str, ending: str) -> Path:
        return self.path / f"{name}.{ending}"


def _private_key(
    pem: bytes,
    name: str,
    passphrase: bytes | None,
    origin: str,
    next_sequence: Callable[[], int] = time.time_ns,
) -> SigningKey:
    """Raises ConfigurationError, which names the origin."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        private = load_pem_private_key(pem, passphrase)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        protected = passphrase is not None
        wrong = "the passphrase is wrong, or the file damaged" if protected else "it is damaged"
        raise ConfigurationError(f"cannot use {origin}: {wrong}") from None
    if not isinstance(private, Ed25519PrivateKey):
        raise ConfigurationError(f"{origin} is not an Ed25519 key")
    return SigningKey(private, name, next_sequence)
