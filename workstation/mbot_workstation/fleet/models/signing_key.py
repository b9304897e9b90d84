"""A private key that signs models and releases."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Self

from mbot_protocol.signing.envelope import Purpose, Signature, sign
from mbot_protocol.signing.public_key import PublicKey

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


class SigningKey:
    """A key in memory.

    Attributes:
        public: its public half, for the robot.

    """

    def __init__(
        self,
        private: "Ed25519PrivateKey",
        name: str,
        next_sequence: Callable[[], int] = time.time_ns,
    ) -> None:
        """Take a private key.

        Args:
            private: the key.
            name: whose it is.
            next_sequence: gives a greater number for each push. The time in ns is one without
                anything to carry along: a key copied to another machine or restored from a backup
                goes on above what it has used before.

        """
        from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

        raw = private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)
        self.public = PublicKey(raw, name)
        self._private = private
        self._next_sequence = next_sequence

    @classmethod
    def ephemeral(cls, name: str) -> Self:
        """A new key that is kept nowhere: for a robot that lives no longer than this program."""
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

        return cls(Ed25519PrivateKey.generate(), name)

    def next_sequence(self) -> int:
        """A number above all that this key has used."""
        return self._next_sequence()

    def sign(self, purpose: Purpose, data: bytes) -> Signature:
        """This key's signature under these bytes, for this purpose alone."""
        return sign(purpose, data, self._private.sign, self.public.raw)
