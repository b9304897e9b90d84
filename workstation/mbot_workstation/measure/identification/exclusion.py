"""Runs that can't be used: what is wrong with each, and what to do."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

MOST_NAMED = 3


class Fault(StrEnum):
    """What is wrong with a run."""

    LATE_TRACK = "late-track"
    SHORT_TRACK = "short-track"
    OTHER_START = "other-start"
    OTHER_TURN = "other-turn"
    ODD_MOTOR = "odd-motor"
    UNLIKE_MODEL = "unlike-model"


REMEDIES = dict.fromkeys(Fault, "drive them again if there are many") | {
    Fault.LATE_TRACK: "begin recording 1 s earlier",
    Fault.SHORT_TRACK: "end recording after the robot stands",
    Fault.OTHER_START: "are these the tracks of these commands?",
}


@dataclass(frozen=True, slots=True)
class Exclusion:
    """Why a run is not used: the fault, and what was seen, with numbers."""

    fault: Fault
    why: str


def grouped(excluded: Mapping[str, Exclusion]) -> list[str]:
    """A line a fault, such as "14 runs (run 3, ...): its track ...; begin recording 1 s earlier".

    Args:
        excluded: by the run's name. Runs with one fault share a line, told by the first run's.

    """
    faults: dict[Fault, list[str]] = {}
    for name, one in excluded.items():
        faults.setdefault(one.fault, []).append(name)
    lines: list[str] = []
    for fault, names in faults.items():
        why, which = excluded[names[0]].why, names[0]
        if len(names) > 1:
            more = ", ..." if len(names) > MOST_NAMED else ""
            which = f"{len(names)} runs ({', '.join(names[:MOST_NAMED])}{more})"
            why = f"of the first, {why}" if len({excluded[name].why for name in names}) > 1 else why
        lines.append(f"{which}: {why}; {REMEDIES[fault]}")
    return lines
