"""TOML files as typed values: read strictly, every mistake one line with file, key and value."""

import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar, cast

import msgspec

from mbot_protocol.errors import ConfigurationError

T = TypeVar("T")

_PLACE = re.compile(r"(?P<what>.*?) - at `\$\.?(?P<key>.*)`", re.DOTALL)


def read_toml(path: Path, kind: type[T]) -> T:
    """Read a file as a msgspec Struct.

    A Struct says what its values must be by raising ValueError in `__post_init__`.

    Raises:
        ConfigurationError: it can't be read, is no TOML, or a key is unknown, missing or unusable.

    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigurationError(f"{path} is no text, expected a TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{path} is no valid TOML: {error}") from None
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{path}: {_placed(str(error), document)}") from None


def _placed(message: str, document: dict[str, Any]) -> str:
    """msgspec's message with the key in front, and the value where it is a plain one."""
    found = _PLACE.fullmatch(message)
    if found is None:
        return _begun_small(message)
    key, what = found["key"], _begun_small(found["what"])
    value = _look_up(document, key)
    shown = f" ({value!r})" if isinstance(value, str | int | float) else ""
    return f"{key}: {what}{shown}"


def _begun_small(message: str) -> str:
    for word in ("Object contains", "Object missing", "Expected"):
        if message.startswith(word):
            message = word.lower() + message[len(word) :]
    return message.replace("object contains unknown field", "unknown key").replace(
        "object missing required field", "missing key"
    )


def _look_up(document: dict[str, Any], key: str) -> object:
    """The value at msgspec's path of a key such as `left_motor.gain` or `components[2].name`."""
    value: object = document
    for name, index in re.findall(r"([^.\[\]]+)|\[(\d+)\]", key):
        try:
            value = cast(Any, value)[int(index) if index else name]
        except (KeyError, IndexError, TypeError):
            return None
    return value
