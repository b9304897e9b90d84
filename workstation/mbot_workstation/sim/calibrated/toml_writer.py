"""Writes a typed value as a TOML file, whole or not at all."""

import re
from pathlib import Path
from typing import Any

import msgspec
import tomli_w
from msgspec import Struct

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file

_NUMBERS = re.compile(r"\[\n(?: +[-+.\deE]+,\n)+ *\]")
"""An array of numbers as the library writes it, a line each."""


def write_toml(path: Path, content: Struct, heading: str) -> Path:
    """Write a file, in a folder that is made if need be.

    Args:
        path: of the file.
        content: what to write; fields that are None are left out.
        heading: a first line that says what this is, as a comment.

    Returns:
        The path.

    Raises:
        ConfigurationError: it can't be written.

    """
    document = tomli_w.dumps(_without_none(msgspec.to_builtins(content)))
    text = f"# {heading}\n{_NUMBERS.sub(_on_one_line, document)}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_file.replace(path, text.encode())
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    return path


def _on_one_line(array: re.Match[str]) -> str:
    return f"[{', '.join(array[0].strip('[]').replace(',', ' ').split())}]"


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
