"""A reason why the robot may not drive now."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fault:
    """One word for machines, one line for people: what was found and what to do."""

    kind: str
    detail: str
