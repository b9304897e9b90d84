"""What is wrong, and what is worth knowing."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Fault:
    """A reason why the robot may not drive now.

    One word for machines, one line for people: what was found and what to do.
    """

    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class Notice:
    """Something to know that does not keep the robot from driving; in the form of a fault."""

    kind: str
    detail: str
