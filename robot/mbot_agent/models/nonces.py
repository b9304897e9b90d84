"""Numbers used once: each lets one signed push in, within a minute, and none after a restart.

They make a recorded push worthless without a clock that could be trusted: what a robot without a
battery knows of the time comes from the network, and so from an attacker.
"""

import secrets
import threading
import time

from mbot_protocol.signing.model_manifest import NONCE_BYTES

LIFETIME_S = 60.0

MOST_OUTSTANDING = 64
"""The oldest is forgotten: asking again and again costs no memory. Who can ask so fast as to make
another's number useless can also keep the link busy."""


class Nonces:
    """The numbers handed out and not used yet. Any thread may use it."""

    def __init__(self) -> None:
        self._issued_s: dict[str, float] = {}  # in the order of issue
        self._lock = threading.Lock()

    def issue(self) -> str:
        """A new number, in hexadecimal."""
        nonce = secrets.token_hex(NONCE_BYTES)
        with self._lock:
            while len(self._issued_s) >= MOST_OUTSTANDING:
                del self._issued_s[next(iter(self._issued_s))]
            self._issued_s[nonce] = time.monotonic()
        return nonce

    def use(self, nonce: str) -> bool:
        """Whether the number was handed out, is young enough and unused; now it is used."""
        with self._lock:
            issued_s = self._issued_s.pop(nonce, None)
        return issued_s is not None and time.monotonic() - issued_s <= LIFETIME_S
