"""Runs that can't be used: why, and in few words those with one fault together, with what to do."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto


class Fault(Enum):
    """What is wrong with a run."""

    BEGINS_LATE = auto()
    ENDS_EARLY = auto()
    OFF_TIME = auto()
    ODD_TURN = auto()
    ODD_LEFT_MOTOR = auto()
    ODD_RIGHT_MOTOR = auto()
    UNEXPLAINED = auto()


_REMEDIES = {
    Fault.BEGINS_LATE: "begin recording 1 s earlier",
    Fault.ENDS_EARLY: "end recording after the robot has stopped",
    Fault.OFF_TIME: "are these the tracks of these commands?",
}
_DRIVE_AGAIN = "drive them again if there are many"

MOST_NAMED = 3


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A run that can't be used.

    Attributes:
        fault: runs with the same one are told together.
        why: in words, with this run's numbers.

    """

    fault: Fault
    why: str


def reasons(left_out: Mapping[str, LeftOut]) -> dict[str, str]:
    """For programs: why, by the run's name."""
    return {name: one.why for name, one in left_out.items()}


def grouped(left_out: Mapping[str, LeftOut]) -> list[str]:
    """A line a fault: "14 runs (run 3, ...): its track ...; begin recording 1 s earlier"."""
    faults: dict[Fault, list[str]] = {}
    for name, one in left_out.items():
        faults.setdefault(one.fault, []).append(name)
    lines: list[str] = []
    for fault, names in faults.items():
        why = left_out[names[0]].why
        which = names[0]
        if len(names) > 1:
            more = ", ..." if len(names) > MOST_NAMED else ""
            which = f"{len(names)} runs ({', '.join(names[:MOST_NAMED])}{more})"
            if len({left_out[name].why for name in names}) > 1:
                why = f"of the first, {why}"
        lines.append(f"{which}: {why}; {_REMEDIES.get(fault, _DRIVE_AGAIN)}")
    return lines
