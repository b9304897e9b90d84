"""What is wrong with the words of a command line, in one line."""

import re
from typing import Any

import typer

from mbot_protocol.errors import ConfigurationError

_POSSIBLE = re.compile(r"[\s(]*(?:Possible options?:|Did you mean(?: one of)?:?)\s*(.*?)[?)]*$")

_INPUT = re.compile(r"Input should be (?:less|greater) than.*$")
_BOUNDS = {"le": "at most", "ge": "at least", "lt": "less than", "gt": "more than"}


def is_usage_error(error: Exception) -> bool:
    """Whether it is about the words of a command line; typer itself does not name the class."""
    return isinstance(error, typer.BadParameter.__mro__[1])


def usage_error(error: Any) -> ConfigurationError | None:
    """A usage error of typer's as one of ours: what was found, what may have been meant, where help
    is; None where nothing needs to be said.
    """
    text = " ".join(error.format_message().split()).replace("Value error, ", "")
    text = _INPUT.sub(lambda found: _out_of_bounds(error) or found[0], text)
    if not text:  # no words at all were given, and typer has shown the help instead
        return None
    meant = ""
    if found := _POSSIBLE.search(text):
        text, names = text[: found.start()], found[1].replace("'", "")
        meant = f"did you mean {' or '.join(names.split(', '))}? "
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "workstation"
    text = f"{text[:1].lower()}{text[1:].rstrip(' .')}"
    return ConfigurationError(text, kind="usage", remedy=f"{meant}see `{path} --help`")


def _out_of_bounds(error: Any) -> str:
    """What was found and expected; also of NaN, of which pydantic says that it should be less."""
    tell = getattr(error.__cause__, "errors", None)
    found = tell()[0] if tell is not None else {}
    bounds = [f"{_BOUNDS[name]} {value:g}" for name, value in found.get("ctx", {}).items()]
    return f"{found['input']!r}, expected a number, {' and '.join(bounds)}" if bounds else ""
