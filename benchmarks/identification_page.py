"""What `benchmarks/identification.py` measured, as a page."""

from collections.abc import Sequence
from datetime import date
from typing import Any

from machine import machine

from mbot_workstation.learn.evaluation.provenance import provenance

Results = dict[str, dict[str, Any]]

BARS = {
    "speed_percent": 2.0,
    "turn_rate_percent": 2.0,
    "time_constant_percent": 10.0,
    "path_ratio": 1.5,
}
"""What must be recovered, and how well."""

INSIDE_PERCENT = 90.0
"""Of the true speeds and turn rates must lie within what is told to be 95 %."""


def misses(result: dict[str, Any]) -> list[str]:
    """The bars that a result does not keep."""
    found = [name for name, bar in BARS.items() if result[name] > bar]
    return [*found, "inside_percent"] if result["inside_percent"] < INSIDE_PERCENT else found


def page(results: Results, about: str) -> str:
    """Markdown."""
    kept = sum(not misses(result) for result in results.values())
    return (
        "\n\n".join(
            [
                "# How well robots are identified",
                f"Made by `benchmarks/identification.py` on {date.today().isoformat()}: "
                f"{machine()}. {kept} of {len(results)} robots kept within every bar.",
                provenance([]),
                about.strip(),
                "Speeds and turn rates are off by so many percent of the robot's largest, in the "
                "worst of all eight maneuvers, with a fresh battery; of the time constants it is "
                "the middle one. *Inside* is how many of the sixteen rates lie within the told "
                "95 %. The last columns are of runs that were held out of the fit: how far "
                "the simulated robot ends from the real one after 10 s, root mean square, before "
                "and after, and against how far repetitions end from their own mean. Bold is "
                "beyond the bar. The clock depends on who else uses the machine.",
                _recovered(results),
                _left_out(results),
            ]
        ).rstrip()
        + "\n"
    )


def _recovered(results: Results) -> str:
    headings = (
        "robot",
        "runs",
        "speed",
        "turn rate",
        "time constants",
        "inside",
        "model misses",
        "path, before → after",
        "against repetitions",
        "processor, clock",
    )
    rows: list[tuple[str, ...]] = [headings, ("---",) * len(headings)]
    rows.append(("*bar*", "", "2 %", "2 %", "10 %", "90 %", "", "", "1.5", ""))
    for name, one in results.items():
        missed = misses(one)

        def told(key: str, text: str, missed: list[str] = missed) -> str:
            return f"**{text}**" if key in missed else text

        rows.append(
            (
                name,
                str(one["runs"]),
                told("speed_percent", f"{one['speed_percent']:.2f} %"),
                told("turn_rate_percent", f"{one['turn_rate_percent']:.2f} %"),
                told("time_constant_percent", f"{one['time_constant_percent']:.1f} %"),
                told("inside_percent", f"{one['inside_percent']:.0f} %"),
                f"{one['misfit_percent']:.1f} %",
                f"{one['path_cm_before']:.0f} → {one['path_cm_after']:.1f} cm",
                told("path_ratio", f"{one['path_ratio']:.2f}"),
                f"{one['cpu_s']:.0f}, {one['wall_s']:.0f} s",
            )
        )
    return _table(rows)


def _left_out(results: Results) -> str:
    lines = [
        f"- {name}, {run}: {why}"
        for name, result in results.items()
        for run, why in result["left_out"].items()
    ]
    return "Left out:\n\n" + "\n".join(lines) if lines else "No run was left out."


def _table(rows: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)
