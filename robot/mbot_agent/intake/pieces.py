"""A push on its way in, piece after piece, whole or forgotten."""

import secrets
import time
from collections.abc import Callable

from mbot_protocol.errors import RefusedError
from mbot_protocol.wire.keys import CHUNK_BYTES

STAGING_EXPIRES_S = 15.0
"""Silence after which an unfinished push is forgotten and another one may begin."""


class Pieces:
    """One push.

    Attributes:
        push_id: how the sender's next messages name it.
        size_bytes: of the whole, as announced.
        received_bytes: how much is here.

    """

    def __init__(self, size_bytes: int, longest_s: float, keep: Callable[[bytes], object]) -> None:
        """Nothing is here yet.

        Args:
            size_bytes: of the whole.
            longest_s: it may take no longer, whatever it sends: one that trickles would keep
                others out for ever.
            keep: takes each piece; what it raises, `add` raises.

        """
        self.push_id = secrets.token_hex(8)
        self.size_bytes = size_bytes
        self.received_bytes: int = 0
        self._longest_s = longest_s
        self._keep = keep
        self._began_s = self._touched_s = time.monotonic()

    @property
    def has_expired(self) -> bool:
        """Whether the sender has fallen silent, or takes too long."""
        now_s = time.monotonic()
        silent = now_s - self._touched_s > STAGING_EXPIRES_S
        return silent or now_s - self._began_s > self._longest_s

    def add(self, offset_bytes: int, data: bytes) -> None:
        """Take the next chunk.

        Raises:
            RefusedError: it doesn't follow the last one, or is too long.

        """
        if offset_bytes != self.received_bytes:
            raise RefusedError(
                f"a chunk begins at byte {offset_bytes}, expected {self.received_bytes}: push again"
            )
        most = min(CHUNK_BYTES, self.size_bytes - self.received_bytes)
        if not 0 < len(data) <= most:
            raise RefusedError(f"a chunk has {len(data)} bytes, expected 1 to {most}")
        self._keep(data)
        self.received_bytes += len(data)
        self._touched_s = time.monotonic()

    def check_whole(self) -> None:
        """Is all of it here?

        Raises:
            RefusedError: no.

        """
        if self.received_bytes != self.size_bytes:
            raise RefusedError(
                f"{self.received_bytes} of {self.size_bytes} bytes have arrived: push again"
            )
