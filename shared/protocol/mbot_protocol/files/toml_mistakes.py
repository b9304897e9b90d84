"""What is wrong with a TOML file's content, in a person's words: key, line, what was expected."""

import re
from typing import Any, cast

import msgspec
from msgspec import inspect

from mbot_protocol.did_you_mean import did_you_mean

Path = tuple[str | int, ...]
"""Of a value in a document: keys, and numbers in lists."""

_PLACE = re.compile(r"(?P<what>.*?) - at `\$\.?(?P<key>.*)`", re.DOTALL)
_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]|\[\.\.\.\]")
_ANY_KEY = ""
"""msgspec writes [...] for whichever key of a table that may have any."""
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`")
_MISSING = re.compile(r"Object missing required field `(.*)`")
_TYPES = re.compile(r"`([a-z |]+)`")
_WHOLE = re.compile(r"(?<=\d)\.0\b")
_HEADER = re.compile(r"\s*(\[{1,2})\s*([^\[\]]+?)\s*\]")
_ENTRY = re.compile(r"\s*([\w.\"'-]+)\s*=")

_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "a text in quotes",
    "bool": "true or false",
    "array": "a list in [ ]",
    "object": "a section",
}


def mistake(error: msgspec.ValidationError, text: str, document: dict[str, Any], kind: Any) -> str:
    """msgspec's message in words.

    Args:
        error: what it raised.
        text: of the file, for the line.
        document: the file as read.
        kind: the Struct that it should have become.

    """
    found = _PLACE.fullmatch(str(error))
    what, place = (found["what"], found["key"]) if found else (str(error), "")
    path = tuple(int(index) if index else name for name, index in _STEP.findall(place))
    if unknown := _UNKNOWN.fullmatch(what):
        name = unknown[1]
        full = (*path, name)
        meant = did_you_mean(name, _fields(kind, path))
        return f"{_dotted(full)} is unknown{_line(text, full)}{meant}"
    if missing := _MISSING.fullmatch(what):
        name, where = missing[1], f"; add it{_section(text, path)}"
        return f"{_dotted((*path, name))} is missing{where}"
    choices = _choices(kind, path)
    path = _with_key(document, path, choices)
    value = _look_up(document, path)
    shown = f" is {value!r}" if isinstance(value, str | int | float) else ""
    named = f"{_dotted(path)}{shown}{_line(text, path)}"
    if what.startswith("Invalid enum value"):
        meant = did_you_mean(str(value), choices)
        return f"{named}, expected one of {', '.join(choices)}{meant}"
    if what.startswith("Expected"):
        expected = _TYPES.sub(_worded, what.partition(", got ")[0].replace("Expected", "expected"))
        return f"{named}, {_WHOLE.sub('', expected)}"
    if not path:
        return what
    # A section's own words begin with the key that they are about.
    return f"{_dotted(path)}: {what}{_line(text, (*path, what.split()[0])) or _line(text, path)}"


def line_number(text: str, path: Path) -> int | None:
    """The line, from 1, where a key or section stands; None where it is not found."""
    keys = [step for step in path if isinstance(step, str)]
    index = next((step for step in path if isinstance(step, int)), 0)
    seen: dict[tuple[str, ...], int] = {}
    section: tuple[str, ...] = ()
    passed = False
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            section = _split(header[2])
            seen[section] = seen.get(section, -1) + 1
            # Of an array of tables, the one meant.
            passed = header[1] == "[[" and seen[section] < index
            if list(section[: len(keys)]) == keys and not passed:
                return number
        elif (entry := _ENTRY.match(line)) and not passed:
            full = (*section, *_split(entry[1]))
            if list(full[: len(keys)]) == keys:
                return number
    return None


def _line(text: str, path: Path) -> str:
    number = line_number(text, path)
    return "" if number is None else f" (line {number})"


def _section(text: str, path: Path) -> str:
    number = line_number(text, path) if path else None
    return "" if number is None else f" to [{_dotted(path)}] (line {number})"


def _dotted(path: Path) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")


def _split(name: str) -> tuple[str, ...]:
    return tuple(part.strip().strip("\"'") for part in name.split("."))


def _worded(types: re.Match[str]) -> str:
    names = [name for name in types[1].split(" | ") if name != "null"]
    return " or ".join(_WORDS.get(name, name) for name in names)


def _fields(kind: Any, path: Path) -> list[str]:
    """The keys that a section may have."""
    return [
        field.encode_name
        for one in _at(kind, path)
        if isinstance(one, inspect.StructType)
        for field in one.fields
    ]


def _choices(kind: Any, path: Path) -> list[str]:
    found: list[str] = []
    for one in _at(kind, path):
        if isinstance(one, inspect.LiteralType):
            found += map(str, one.values)
        elif isinstance(one, inspect.EnumType):
            found += [str(member.value) for member in one.cls]
        elif isinstance(one, inspect.BoolType):
            found += ["true", "false"]
    return found


def _with_key(document: dict[str, Any], path: Path, choices: list[str]) -> Path:
    """The path with the key that msgspec leaves out: the first whose value is not a choice."""
    if _ANY_KEY not in path:
        return path
    at = path.index(_ANY_KEY)
    table = _look_up(document, path[:at])
    keys = list(cast(dict[str, Any], table)) if isinstance(table, dict) else [_ANY_KEY]
    paths = [(*path[:at], key, *path[at + 1 :]) for key in keys]
    wrong = [one for one in paths if str(_look_up(document, one)) not in choices]
    return (wrong or paths)[0]


def _at(kind: Any, path: Path) -> list[inspect.Type]:
    """The types that may stand at a path."""
    found = _alternatives(inspect.type_info(kind))
    for step in path:
        below: list[inspect.Type] = []
        for one in found:
            if isinstance(one, inspect.StructType):
                below += [field.type for field in one.fields if field.encode_name == step]
            elif isinstance(one, inspect.DictType):
                below.append(one.value_type)
            elif isinstance(one, inspect.ListType | inspect.VarTupleType):
                below.append(one.item_type)
        found = [alternative for one in below for alternative in _alternatives(one)]
    return found


def _alternatives(one: inspect.Type) -> list[inspect.Type]:
    return list(one.types) if isinstance(one, inspect.UnionType) else [one]


def _look_up(document: dict[str, Any], path: Path) -> object:
    """The value at a path; None where it can't be followed."""
    value: object = document
    for step in path:
        try:
            value = cast(Any, value)[step]
        except (KeyError, IndexError, TypeError):
            return None
    return value
