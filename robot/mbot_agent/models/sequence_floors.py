"""The highest sequence accepted of each signing key, on disk: no older push is taken again."""

import logging
from pathlib import Path

import msgspec

from mbot_protocol.errors import RefusedError
from mbot_protocol.files import atomic_file

log = logging.getLogger(__name__)


class SequenceFloors:
    """One number a key. Each key counts for itself, so people's clocks need not agree.

    Only one thread at a time may raise a floor.
    """

    def __init__(self, directory: Path) -> None:
        self._path = directory / "sequences.json"
        self._floors = self._read()

    def of(self, public_key: bytes) -> int:
        """The highest sequence accepted of this key; 0: none yet."""
        return self._floors.get(public_key.hex(), 0)

    def reach(self, public_key: bytes, sequence: int) -> None:
        """Note that a sequence has been accepted; a floor never goes down.

        Raises:
            RefusedError: the disk refuses; the floor is what it was.

        """
        if sequence <= self.of(public_key):
            return
        floors = self._floors | {public_key.hex(): sequence}
        try:
            atomic_file.replace(self._path, msgspec.json.encode(floors))
        except OSError as error:
            raise RefusedError(f"cannot note the model's sequence: {error.strerror}") from None
        self._floors = floors

    def _read(self) -> dict[str, int]:
        try:
            return msgspec.json.decode(self._path.read_bytes(), type=dict[str, int])
        except FileNotFoundError:
            return {}
        except (OSError, msgspec.DecodeError) as error:
            # Refusing every push for a damaged file would need a person at the robot, and a
            # recorded push still lacks the nonce.
            log.error(
                "the sequences accepted so far are unreadable, counting from scratch: %s", error
            )
            return {}
