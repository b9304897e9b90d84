"""A policy as a file, and what is said of it."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from mbot_protocol.files import atomic_file
from mbot_workstation.wording import short_digest, size_words

if TYPE_CHECKING:
    import onnx


class WrittenPolicy(msgspec.Struct, frozen=True, omit_defaults=True):
    """A policy's file.

    Attributes:
        path: of the file.
        name: what robots call it.
        sha256: its digest.
        size_bytes: of the file.
        checkpoint: whose weights it has, if it was trained.

    """

    path: Path
    name: str
    sha256: str
    size_bytes: int
    checkpoint: Path | None = None

    def sentence(self, next_command: str) -> str:
        """What was written, and what to do with it."""
        return (
            f"wrote {self.path}: {self.name} {short_digest(self.sha256)}, "
            f"{size_words(self.size_bytes)}; next: {next_command}"
        )


def write_policy(
    path: Path, name: str, model: "onnx.ModelProto", checkpoint: Path | None = None
) -> WrittenPolicy:
    """Write a model; the same one gives the same bytes.

    Raises:
        ConfigurationError: the file can't be written.

    """
    data = model.SerializeToString(deterministic=True)
    atomic_file.save(path, data)
    return WrittenPolicy(path, name, hashlib.sha256(data).hexdigest(), len(data), checkpoint)
