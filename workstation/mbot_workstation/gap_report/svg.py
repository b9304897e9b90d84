"""Figures as SVG to be put into a page, and the colours and letters they share."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from mbot_workstation.gap_report.compared_run import CALIBRATED, MEASURED, NOMINAL

COLOURS = {MEASURED: "#1c1c1e", CALIBRATED: "#2f6fb2", NOMINAL: "#d9772b"}
"""Dark for what is real, blue for the calibrated simulation, orange for the nominal one."""

NAMES = {MEASURED: "measured", CALIBRATED: "simulated", NOMINAL: "nominal simulation"}

GRID, INK, FAINT = "#e4e4e7", "#3f3f46", "#a1a1aa"

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "path",  # looks the same wherever it is opened
    "svg.hashsalt": "gap-report",  # the same data makes the same file
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "path.simplify_threshold": 0.3,
}


@contextmanager
def styled() -> Iterator[None]:
    """Figures are made and written in here."""
    with mpl.rc_context(_STYLE):
        yield


def to_svg(figure: Figure, name: str, words: str) -> str:
    """The figure as an element of an HTML page, as wide as its place.

    Args:
        figure: made within `styled`.
        name: unique on the page: every id gets it in front.
        words: what it shows, for those who can't see it.

    """
    buffer = StringIO()
    with styled():
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'(href="|url\()#', rf"\1#{name}-", text)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*pt"', r"\1", text)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*pt"', r"\1", text)
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text).replace("xlink:href", "href")
    return text.replace("<svg", f'<svg role="img" aria-label="{words}"', 1)
