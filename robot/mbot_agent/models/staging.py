"""A pushed model on its way in: its bytes in memory, whole or forgotten."""

from mbot_agent.intake.pieces import Pieces
from mbot_agent.models.trust import Admission

LONGEST_S = 60.0
"""The largest model (16 MiB) then needs 280 kB/s."""


class Staging(Pieces):
    """One push of a model.

    Attributes:
        sha256: of the model, as announced.
        expected_active: the digest that was active when it began.
        admission: why it was let in.

    """

    def __init__(
        self, sha256: str, size_bytes: int, expected_active: str, admission: Admission
    ) -> None:
        self._data = bytearray()
        super().__init__(size_bytes, LONGEST_S, self._data.extend)
        self.sha256 = sha256
        self.expected_active = expected_active
        self.admission = admission

    def whole(self) -> bytes:
        """All bytes; the staging has none afterwards.

        Raises:
            RefusedError: some are missing.

        """
        self.check_whole()
        data = bytes(self._data)
        self._data.clear()
        return data
