"""What the daemon tells root's updater of itself: may its wheels turn, and what is in the way?

A small JSON file in the daemon's runtime directory, which goes with the daemon. Standard library
only.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

SCHEMA = 1
DIRECTORY = Path("/run/mbot-agent")
"""As RuntimeDirectory= of the daemon's unit."""

FILE = "state.json"
LARGEST_BYTES = 4096
"""Ours have about 100."""


@dataclass(frozen=True, slots=True)
class DaemonState:
    """What holds since a moment.

    Attributes:
        armed: whether its wheels turn, or would as soon as nothing is in the way any more.
        faults: the kinds of what is in the way.
        pid: whose state it is.
        monotonic_ns: when it began to hold.

    """

    armed: bool
    faults: tuple[str, ...]
    pid: int = 0
    monotonic_ns: int = 0

    def to_bytes(self) -> bytes:
        """The file's content; `from_bytes` reads it."""
        return json.dumps({"schema": SCHEMA} | asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> "DaemonState | None":
        """Read a file's content; None if that is not one, or of a newer kind."""
        if len(data) > LARGEST_BYTES:
            return None
        try:
            found: dict[str, Any] = json.loads(data)
            schema, faults = found.pop("schema"), tuple(found.pop("faults"))
            state = cls(faults=faults, **found)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return None
        numbers: tuple[Any, ...] = (schema, state.pid, state.monotonic_ns)
        texts: tuple[Any, ...] = state.faults
        right = type(state.armed) is bool and schema == SCHEMA
        right = right and all(type(one) is int for one in numbers)
        return state if right and all(type(one) is str for one in texts) else None
