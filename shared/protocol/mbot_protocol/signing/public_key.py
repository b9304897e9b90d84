"""A signing key's public half: one line of text, `ed25519:BASE64 name`, and what it can check.

`workstation keys` prints the line, the robot's `[trust] keys` takes it.
"""

import base64
import binascii
import re
from dataclasses import dataclass

from mbot_protocol.errors import ConfigurationError

PUBLIC_KEY_BYTES = 32
SIGNATURE_BYTES = 64

_KIND = "ed25519:"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]{0,47}")


def check_key_name(name: str) -> str:
    """Return the name if it is fit for a file name and for one word of a line.

    Raises:
        ConfigurationError: it is not.

    """
    if not _NAME.fullmatch(name):
        raise ConfigurationError(
            f"the key's name is {name!r}, expected 1 to 48 letters, digits, '_', '-', '.', '@', "
            "such as 'anna'"
        )
    return name


@dataclass(frozen=True, slots=True)
class PublicKey:
    """A public key and what people call it.

    Attributes:
        raw: the 32 bytes of RFC 8032. Two keys are the same if these are.
        name: whose it is; not part of the key.

    """

    raw: bytes
    name: str

    @property
    def line(self) -> str:
        """The text form, which `parse` reads."""
        return f"{_KIND}{base64.b64encode(self.raw).decode()} {self.name}"

    def has_signed(self, message: bytes, signature: bytes) -> bool:
        """Whether this is the key's Ed25519 signature (RFC 8032) of the message; whatever is wrong
        with the key or the signature, the answer is no.
        """
        # Here, so that the updater, which has nothing but the standard library, can read keys.
        from nacl.exceptions import BadSignatureError
        from nacl.signing import VerifyKey

        try:
            VerifyKey(self.raw).verify(message, signature)
        except (BadSignatureError, ValueError):
            return False
        return True

    @classmethod
    def parse(cls, line: str) -> "PublicKey":
        """Read the text form.

        Raises:
            ConfigurationError: another kind of key, not 32 bytes of base64, or no proper name.

        """
        text, _, name = line.strip().partition(" ")
        try:
            raw = base64.b64decode(text.removeprefix(_KIND), validate=True)
        except (binascii.Error, ValueError):
            raw = b""
        if not text.startswith(_KIND) or len(raw) != PUBLIC_KEY_BYTES:
            raise ConfigurationError(
                f"{line[:80]!r} is not a signing key, expected a line 'ed25519:BASE64 name' as "
                "`workstation keys show` prints it"
            )
        return cls(raw, check_key_name(name.strip()))
