"""A push on its way in: its bytes in memory, whole or forgotten."""

import logging
import secrets
import time

from mbot_agent.models.trust import Admission
from mbot_protocol.errors import RefusedError
from mbot_protocol.keys import CHUNK_BYTES

log = logging.getLogger(__name__)

STAGING_EXPIRES_S = 15.0
"""Silence after which an unfinished push is forgotten and another one may begin."""


LONGEST_S = 60.0
"""A push may take no longer, whatever it sends: one that trickles would keep others out for ever.
The largest model (16 MiB) needs 280 kB/s."""


class Staging:
    """One push.

    Attributes:
        push_id: how the sender's next messages name it.
        sha256, size_bytes: of the model, as announced.
        expected_active: the digest that was active when it began.
        admission: why it was let in.

    """

    def __init__(
        self, sha256: str, size_bytes: int, expected_active: str, admission: Admission
    ) -> None:
        self.push_id = secrets.token_hex(8)
        self.sha256 = sha256
        self.size_bytes = size_bytes
        self.expected_active = expected_active
        self.admission = admission
        self._data = bytearray()
        self._began_s = self._touched_s = time.monotonic()

    @property
    def received_bytes(self) -> int:
        """How much is here."""
        return len(self._data)

    @property
    def has_expired(self) -> bool:
        """Whether the sender has fallen silent, or takes too long."""
        now_s = time.monotonic()
        return now_s - self._touched_s > STAGING_EXPIRES_S or now_s - self._began_s > LONGEST_S

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
        self._data += data
        self._touched_s = time.monotonic()

    def whole(self) -> bytes:
        """All bytes; the staging has none afterwards.

        Raises:
            RefusedError: some are missing.

        """
        if self.received_bytes != self.size_bytes:
            raise RefusedError(
                f"{self.received_bytes} of {self.size_bytes} bytes have arrived: push again"
            )
        data = bytes(self._data)
        self._data = bytearray()
        return data
