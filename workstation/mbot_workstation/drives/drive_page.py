"""Recorded drives as one HTML page that needs nothing else: no file, no network, no script."""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from mbot_protocol.actions import STEP_LIMIT
from mbot_workstation.drives.drive_figures import DriveFigures, Latency
from mbot_workstation.pictures.picture_file import encode_picture
from mbot_workstation.wording import one_line, short_digest

STRIP_TILES = 24
"""Rows of 12, 8, 6 or 4 are full, whatever the page's width."""

CHART_WIDTH, CHART_HEIGHT = 720, 120
SHOWN = ("frame to motors", "decide", "tick late by")
"""Stages whose histograms are drawn; all of them stand in the table."""

MOST_POINTS = 1500
"""Of a wheel's line: more than pixels across."""

JPEG_QUALITY = 92


def drive_page(drives: Sequence[DriveFigures]) -> str:
    """The whole page: one drive, or several below one another on the same scales."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    longest_ms = {name: _longest_ms(name, drives) for name in SHOWN}
    environment.filters |= {"one_line": one_line, "short": short_digest}
    return environment.get_template("drive_page.html").render(
        drives=drives,
        strips=[_strip(one) for one in drives],
        lines=[_lines(one) for one in drives],
        histograms=[
            [
                (latency, _bars(latency, longest_ms[latency.name]), longest_ms[latency.name])
                for latency in one.latencies
                if latency.name in SHOWN
            ]
            for one in drives
        ],
        width=CHART_WIDTH,
        height=CHART_HEIGHT,
    )


@dataclass(frozen=True, slots=True)
class Tile:
    """One picture of the strip: an address inside the page, when, and both wheels in [-1, 1]."""

    uri: str
    since_s: float
    left: float
    right: float


def _strip(one: DriveFigures) -> list[Tile]:
    """Pictures over the whole drive, as the policy saw them: the page enlarges them."""
    found: list[Tile] = []
    for beat in one.chosen(STRIP_TILES):
        picture, steps = beat.observation, beat.decision.steps
        if picture is not None:
            encoded = base64.b64encode(encode_picture(picture, ".jpg", JPEG_QUALITY)).decode()
            found.append(
                Tile(
                    f"data:image/jpeg;base64,{encoded}",
                    one.drive.since_s(beat),
                    steps.left / STEP_LIMIT,
                    steps.right / STEP_LIMIT,
                )
            )
    return found


def _lines(one: DriveFigures) -> dict[str, str]:
    """Both wheels over time as points of a polyline."""
    wheels = one.wheels
    wheels = wheels[:: math.ceil(len(wheels) / MOST_POINTS)]
    span_s = max(one.drive.duration_s, 1e-3)
    middle = CHART_HEIGHT / 2

    def points(index: int) -> str:
        return " ".join(
            f"{CHART_WIDTH * beat[0] / span_s:.1f},{middle - (middle - 4) * beat[index]:.1f}"
            for beat in wheels
        )

    return {"left": points(1), "right": points(2)}


def _bars(latency: Latency, until_ms: float) -> list[tuple[float, float]]:
    """Left edge and height of each bin, as shares of the chart."""
    counts = latency.histogram(until_ms)
    # A single slow decision must be seen beside hundreds of quick ones.
    highest = math.sqrt(max(counts))
    return [(index / len(counts), math.sqrt(n) / highest) for index, n in enumerate(counts)]


def _longest_ms(name: str, drives: Sequence[DriveFigures]) -> float:
    values = [
        value
        for one in drives
        for latency in one.latencies
        if latency.name == name
        for value in latency.values_ms
    ]
    return max(values, default=1.0)
