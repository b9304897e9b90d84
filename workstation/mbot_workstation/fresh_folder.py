"""A folder that a command leaves its work in and empties each time, without anybody else's."""

import shutil
from collections.abc import Collection
from pathlib import Path

from mbot_protocol.errors import ConfigurationError


def make_fresh(folder: Path, mark: str, others: Collection[str] = ()) -> None:
    """Make it, or empty it if an earlier run of the same command has left it.

    Args:
        folder: may be the current one, and stays the same folder.
        mark: what every run leaves in it first.
        others: all else that a run leaves.

    Raises:
        ConfigurationError: it holds anything besides, or can't be made or emptied.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = {path.name: path for path in folder.iterdir()}
        foreign = there.keys() if mark not in there else there.keys() - {mark, *others}
        if foreign:
            one = min(foreign, key=lambda name: (name.startswith("."), name))
            raise ConfigurationError(
                f"{folder} holds other things, such as {one}; choose another --output"
            )
        # The mark goes last: whoever is interrupted can begin again.
        for path in sorted(there.values(), key=lambda path: path.name == mark):
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    except OSError as error:
        raise ConfigurationError(f"can't make {folder}: {error.strerror}") from None
