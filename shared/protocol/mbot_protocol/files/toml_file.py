"""TOML files as typed values: read strictly, every mistake one line with file, key and value."""

import tomllib
from pathlib import Path
from typing import TypeVar

import msgspec

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import read_text

T = TypeVar("T")


def read_toml(path: Path, kind: type[T]) -> T:
    """Read a file as a msgspec Struct.

    A Struct says what its values must be by raising ValueError in `__post_init__`.

    Raises:
        ConfigurationError: it can't be read, is not TOML, or a key is unknown, missing or unusable.

    """
    return decode_toml(read_text(path), kind, str(path))


def decode_toml(text: str, kind: type[T], origin: str) -> T:
    """Decode TOML text as a msgspec Struct; `origin` names it in errors.

    Raises:
        ConfigurationError: as `read_toml`.

    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{origin} is not valid TOML: {error}") from None
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        from mbot_protocol.files.toml_mistakes import mistake  # not in every daemon's memory

        raise ConfigurationError(f"{origin}: {mistake(error, text, document, kind)}") from None
    except ConfigurationError as error:
        raise ConfigurationError(f"{origin}: {error}") from None
