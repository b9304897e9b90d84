"""What Git leaves in place of a large file while Git LFS has not fetched it: a note of three lines.

https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md
"""

from pathlib import Path

from mbot_protocol.errors import ConfigurationError

POINTER = b"version https://git-lfs.github.com/spec/"


def refuse_pointer(path: Path, start: bytes) -> None:
    """Tell a pointer from the file that it stands for.

    Args:
        path: of the file, for the message.
        start: its first bytes, at least as many as `POINTER`'s where there are so many.

    Raises:
        ConfigurationError: it is a pointer.

    """
    if start.startswith(POINTER):
        raise ConfigurationError(
            f"{path} is a Git LFS pointer, not the file: fetch it by git lfs pull"
        )
