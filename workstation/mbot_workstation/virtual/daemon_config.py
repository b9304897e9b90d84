"""A daemon's configuration for a virtual robot: written once, and kept while it still fits."""

import json
import tomllib
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file

TEMPLATE = """\
# Written by `workstation virtual-robot --write-config`. All settings: deploy/config.toml.
robot_id = "virtual"

[camera]
source = {camera}

[board]
port = {board}
accept_no_deadman = {accept}

[models]
directory = {models}
"""


def write_daemon_config(path: Path, camera: str, board: str, *, has_deadman: bool) -> None:
    """Write the file, unless it is there and names this camera and this board.

    Args:
        path: of the file; models will be kept beside it.
        camera: where its pictures come from.
        board: its serial port.
        has_deadman: whether the board stops by itself when its commands cease.

    Raises:
        ConfigurationError: the file is for another robot, or can't be read or written.

    """
    try:
        if path.exists():
            _check(path, camera, board)
            return
        texts = {
            "camera": camera,
            "board": board,
            # Recordings are kept beside them: a folder for each configuration.
            "models": str(path.absolute().parent / f"{path.stem}-data" / "models"),
        }
        # A JSON text is a TOML text, too.
        quoted = {name: json.dumps(text, ensure_ascii=False) for name, text in texts.items()}
        text = TEMPLATE.format(**quoted, accept=str(not has_deadman).lower())
        atomic_file.replace(path, text.encode())
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None


def _check(path: Path, camera: str, board: str) -> None:
    try:
        found = tomllib.loads(path.read_text())
        named = found["camera"]["source"], found["board"]["port"]
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, KeyError, TypeError):
        named = ("", "")
    if named != (camera, board):
        raise ConfigurationError(
            f"{path} exists and is for another robot: expected camera {camera} and board {board}; "
            "remove it, or give --write-config another name"
        )
