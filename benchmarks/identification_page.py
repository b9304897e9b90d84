"""What `benchmarks/identification.py` measured, as a page."""

from collections.abc import Sequence
from datetime import date
from typing import Any

from machine import machine

Results = dict[str, dict[str, Any]]

BARS = {
    "speed_percent": 2.0,
    "turn_rate_percent": 2.0,
    "time_constant_percent": 15.0,
    "asymmetry_percent": 1.0,
}
"""What must be recovered, and how well."""

LONGEST_S = 180.0
"""For 80 runs on 2 cores, by the clock: use a quiet machine."""


def misses(result: dict[str, Any]) -> list[str]:
    """The bars that a result does not keep."""
    found = [name for name, bar in BARS.items() if result[name] > bar]
    return [*found, "wall_s"] if result["wall_s"] > LONGEST_S else found


def page(results: Results, command: str, about: str) -> str:
    """Markdown."""
    kept = sum(not misses(result) for result in results.values())
    return (
        "\n\n".join(
            [
                "# How well robots are identified",
                f"Made by `{command}` on {date.today().isoformat()}: {machine()}. "
                f"{kept} of {len(results)} robots kept within every bar.",
                about.strip(),
                "## What was recovered",
                "Off by at most, over all eight manoeuvres; bold is beyond the bar.",
                _recovered(results),
                "## Runs that were not fitted",
                "Medians. Before is the nominal robot. *Repeats to* is how far repetitions are "
                "from their own mean (root mean square): no simulation can be better.",
                _held_out(results),
                _left_out(results),
            ]
        ).rstrip()
        + "\n"
    )


def _recovered(results: Results) -> str:
    headings = (
        "robot",
        "runs",
        "straight speed",
        "turn rate",
        "time constant",
        "asymmetry",
        "processor",
        "clock",
    )
    rows = [headings, ("---",) * len(headings)]
    bars = [f"{bar:g} %" for bar in BARS.values()]
    rows.append(("*bar*", "", *bars, "", f"{LONGEST_S:g} s"))
    for name, result in results.items():
        missed = misses(result)
        numbers = [
            f"**{result[key]:.2f} %**" if key in missed else f"{result[key]:.2f} %" for key in BARS
        ]
        clock = f"{result['wall_s']:.0f} s"
        clock = f"**{clock}**" if "wall_s" in missed else clock
        rows.append((name, str(result["runs"]), *numbers, f"{result['cpu_s']:.0f} s", clock))
    return _table(rows)


def _held_out(results: Results) -> str:
    headings = (
        "robot",
        "straight, before → after",
        "repeats to",
        "all, before → after",
        "heading, before → after",
        "repeats to",
    )
    rows: list[tuple[str, ...]] = [headings, ("---",) * len(headings)]
    for name, one in results.items():
        rows.append(
            (
                name,
                f"{one['straight_cm_before']:.0f} → {one['straight_cm_after']:.1f} cm",
                f"{one['straight_cm_repeats']:.1f} cm",
                f"{one['place_cm_before']:.1f} → {one['place_cm_after']:.1f} cm",
                f"{one['heading_deg_before']:.0f} → {one['heading_deg_after']:.1f}°",
                f"{one['heading_deg_repeats']:.1f}°",
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
