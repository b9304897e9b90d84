"""Takes out of texts what nobody but their owner may read: keys, passwords, logins in addresses."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HIDDEN = "***"

_PEM = re.compile(r"-----BEGIN [^-]*-----.*?(?:-----END [^-]*-----|\Z)", re.DOTALL)
_LOGIN = re.compile(r"://.*@")
"""To the last @ of the line: a password may have any character in it, also those that it must not
have in an address. Rather too much than too little."""
_QUERY = re.compile(r"(://[^?\s]*)\?\S*")
_SECRET = r"\w*(?:pass|pwd|secret|token|api_?key|psk|private)\w*"
_NAMED = re.compile(rf"({_SECRET})(\s*[=:]\s*)\S.*", re.IGNORECASE)
_SECRET_NAME = re.compile(_SECRET, re.IGNORECASE)


def redacted(text: str) -> str:
    """A text of any number of lines."""
    text = _PEM.sub("(a key or certificate)", text.replace(str(Path.home()), "~"))
    text = _QUERY.sub(rf"\1?{HIDDEN}", _LOGIN.sub(f"://{HIDDEN}@", text))
    return _NAMED.sub(rf"\1\2{HIDDEN}", text)


def redacted_values(value: Any) -> Any:
    """The same of all texts in a document of JSON or TOML; what is called a password is hidden
    whatever it is.
    """
    if isinstance(value, Mapping):
        return {
            redacted(str(name)): HIDDEN
            if _SECRET_NAME.fullmatch(str(name))
            else redacted_values(inner)
            for name, inner in value.items()
        }
    if isinstance(value, list | tuple):
        return [redacted_values(inner) for inner in value]
    if isinstance(value, str):  # a line break would end what is hidden
        return redacted(value if "-----BEGIN" in value else " ".join(value.splitlines()))
    return value
