"""Runs that can't be used, in few words: those with one fault together, with what to do."""

import re
from collections.abc import Mapping

NUMBER = re.compile(r"[-+]?\d+(\.\d+)?%?")

REMEDIES = {
    "its track does not begin": "begin recording 1 s earlier",
    "its track covers": "end recording after the robot stands",
    "it begins to move": "are these the tracks of these commands?",
    "it turns at": "drive them again if there are many",
    "its left motor was": "drive them again if there are many",
    "its right motor was": "drive them again if there are many",
    "no such robot": "drive them again if there are many",
}
"""By how a reason begins."""

MOST_NAMED = 3


def grouped(left_out: Mapping[str, str]) -> list[str]:
    """A line a fault, such as "14 runs (run 3, ...): its track ...; begin recording 1 s earlier".

    Args:
        left_out: reasons by the run's name. Those that differ in numbers only are one fault, told
            by the first run's.

    """
    faults: dict[str, list[str]] = {}
    for name, why in left_out.items():
        faults.setdefault(NUMBER.sub("#", why), []).append(name)
    lines: list[str] = []
    for names in faults.values():
        why = left_out[names[0]]
        remedy = next((do for begin, do in REMEDIES.items() if why.startswith(begin)), "")
        which = names[0]
        if len(names) > 1:
            more = ", ..." if len(names) > MOST_NAMED else ""
            which = f"{len(names)} runs ({', '.join(names[:MOST_NAMED])}{more})"
            why = f"of the first, {why}" if len({left_out[name] for name in names}) > 1 else why
        lines.append(f"{which}: {why}{f'; {remedy}' if remedy else ''}")
    return lines
