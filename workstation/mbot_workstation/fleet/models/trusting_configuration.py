"""Adds a signing key to a robot's configuration without touching anything else in it."""

import json
import re
import tomllib
from collections.abc import Iterable
from typing import Any, cast

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.signing.public_key import PublicKey

CONFIGURATION = "/etc/mbot-agent/config.toml"
"""Where a robot's daemon looks for it."""

_SECTION = re.compile(r"^[ \t]*\[trust\][ \t]*(#.*)?$", re.MULTILINE)
_NEXT_SECTION = re.compile(r"^[ \t]*\[", re.MULTILINE)
_KEYS = re.compile(r"^[ \t]*keys[ \t]*=[ \t]*\[", re.MULTILINE)


def by_hand(lines: Iterable[str]) -> list[str]:
    """What a person changes to make a new robot trust these keys: where, and the line to paste.

    Not a table of its own: the configuration that comes with the daemon has [trust] already.
    """
    return [
        f"in [trust] of {CONFIGURATION} change the line `keys = []` to:",
        f"keys = {json.dumps(list(lines))}",
    ]


def with_trusted_key(text: str, key: PublicKey, origin: str) -> str:
    """The configuration's text with one more key in `[trust] keys`; the same if it is there.

    Raises:
        ConfigurationError: it is no robot's configuration, or written so that a person has to add
            the line.

    """
    before = _parse(text, origin)
    if before and not before.keys() & {"robot_id", "trust"}:
        raise ConfigurationError(
            f"{origin} has neither robot_id nor [trust], expected a robot's configuration such as "
            f"{CONFIGURATION}"
        )
    old = _keys(before, origin)
    if key.raw in {PublicKey.parse(line).raw for line in old}:
        return text
    changed = _insert(text, f'"{key.line}"')
    trust = cast(dict[str, Any], before.get("trust", {}))
    expected = before | {"trust": trust | {"keys": [key.line, *old]}}
    try:
        understood = tomllib.loads(changed) == expected
    except tomllib.TOMLDecodeError:
        understood = False
    if not understood:
        raise ConfigurationError(
            f'{origin} is written in a way this command does not know: add "{key.line}" to its '
            "[trust] keys by hand"
        )
    return changed


def _parse(text: str, origin: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{origin} is not valid TOML: {error}") from None


def _keys(configuration: dict[str, Any], origin: str) -> list[str]:
    trust = configuration.get("trust", {})
    keys = cast(dict[str, Any], trust).get("keys", []) if isinstance(trust, dict) else None
    if not isinstance(keys, list) or not all(isinstance(line, str) for line in keys):
        raise ConfigurationError(f"{origin}: trust.keys is not a list of lines")
    return cast(list[str], keys)


def _insert(text: str, value: str) -> str:
    section = _SECTION.search(text)
    if section is None:
        gap = "" if not text or text.endswith("\n") else "\n"
        return f"{text}{gap}\n[trust]\nkeys = [{value}]\n"
    end = _NEXT_SECTION.search(text, section.end())
    keys = _KEYS.search(text, section.end(), end.start() if end else len(text))
    if keys is None:
        return f"{text[: section.end()]}\nkeys = [{value}]{text[section.end() :]}"
    rest = text[keys.end() :]
    gap = "" if rest.lstrip().startswith("]") else ", "
    return f"{text[: keys.end()]}{value}{gap}{rest}"
