"""Recorded drives as one HTML page that needs nothing else: no file, no network, no script."""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from mbot_protocol.drive.picture import Picture
from mbot_workstation.look.drives.attention import Looks
from mbot_workstation.look.drives.drive_figures import DriveFigures, Latency
from mbot_workstation.look.drives.driven_path import DrivenPath, PathPoint, Point
from mbot_workstation.pictures.picture_file import encode_picture, observation
from mbot_workstation.wording import one_line, short_digest

STRIP_TILES = 24
"""Rows of 12, 8, 6 or 4 are full, whatever the page's width."""

CHART_WIDTH, CHART_HEIGHT = 720, 120
SHOWN = ("frame to motors", "decide", "tick late by")
"""Stages whose histograms are drawn; all of them stand in the table."""

MAP_MARGIN_M = 0.25

MOST_POINTS = 1500
"""Of a wheel's line: more than pixels across."""

JPEG_QUALITY = 92


def drive_page(
    drives: Sequence[DriveFigures],
    places: Sequence[PathPoint] = (),
    looks: Sequence[Looks] = (),
) -> str:
    """The whole page: one drive, or several below one another on the same scales.

    Args:
        drives: what happened in each.
        places: where a robot was and when, as far as that is known; each drive takes its own time.
        looks: of each drive, where its policy looked; none: that is not shown.

    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    none: list[Looks] = [{}] * len(drives)
    longest_ms = {name: _longest_ms(name, drives) for name in SHOWN}
    environment.filters |= {"one_line": one_line, "short": short_digest}
    return environment.get_template("drive_page.html").render(
        drives=drives,
        strips=[_strip(one, look) for one, look in zip(drives, looks or none, strict=True)],
        lines=[wheel_lines(one) for one in drives],
        maps=[driven_map(one, places) for one in drives],
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
class PageTile:
    """One picture of the strip, when it was seen, and both wheels in [-1, 1].

    `uri` and `looked_uri` are addresses inside the page: the picture, and what mattered in it to
    the policy; empty: not known.
    """

    uri: str
    looked_uri: str
    since_s: float
    left: float
    right: float


def _strip(one: DriveFigures, looks: Looks) -> list[PageTile]:
    """Pictures over the whole drive, as the policy saw them: the page enlarges them."""
    found: list[PageTile] = []
    for beat in one.chosen(STRIP_TILES):
        picture = observation(beat)
        if picture is not None:
            looked = looks.get(beat.key)
            found.append(
                PageTile(
                    picture_uri(picture),
                    "" if looked is None else picture_uri(looked.picture),
                    one.drive.since_s(beat),
                    *one.drive.at_wheels(beat),
                )
            )
    return found


def picture_uri(picture: Picture) -> str:
    """The picture itself, as an address inside a page."""
    encoded = base64.b64encode(encode_picture(picture, ".jpg", JPEG_QUALITY)).decode()
    return f"data:image/jpeg;base64,{encoded}"


@dataclass(frozen=True, slots=True)
class PageMap:
    """A path from above, in metres, y down as SVG has it.

    Attributes:
        left, top, width, height: what is shown.
        strips: points of polylines.
        begin, end: of the path.
        targets: places of the object.

    """

    left: float
    top: float
    width: float
    height: float
    strips: tuple[str, ...]
    begin: Point
    end: Point
    targets: tuple[Point, ...]


def driven_map(one: DriveFigures, places: Sequence[PathPoint]) -> PageMap | None:
    """A drive's own part of a path; None where nothing is known of it."""
    first, last = (one.drive.beats[index].decision.unix_time_ns for index in (0, -1))
    driven, targets = DrivenPath(longest=None), dict[Point, None]()
    for place in places:
        if first <= place.unix_time_ns <= last:
            driven.add(place)
            x_m, y_m = place.target
            targets[round(x_m, 2), round(-y_m, 2)] = None
    strips = [[(x_m, -y_m) for x_m, y_m in strip] for strip in driven.strips]
    if not strips:
        return None
    points = [point for strip in strips for point in strip]
    seen_x, seen_y = zip(*points, *targets, strict=True)
    left, top = min(seen_x) - MAP_MARGIN_M, min(seen_y) - MAP_MARGIN_M
    return PageMap(
        left,
        top,
        max(seen_x) + MAP_MARGIN_M - left,
        max(seen_y) + MAP_MARGIN_M - top,
        tuple(" ".join(f"{x:.3f},{y:.3f}" for x, y in strip) for strip in strips),
        points[0],
        points[-1],
        tuple(targets),
    )


def wheel_lines(one: DriveFigures) -> dict[str, str]:
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
