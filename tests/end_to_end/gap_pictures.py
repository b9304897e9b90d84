"""Pictures of two gap reports, a rehearsal's and one of recordings alone.

`python -m tests.end_to_end.gap_pictures REHEARSAL.html RECORDINGS.html docs/images`
"""

import sys
from pathlib import Path

from playwright.sync_api import Page

from .browser import browser

WIDTH_PX, HEIGHT_PX = 1000, 900
MARGIN_PX = 10
TALLEST_PX = {"gap-paths.png": 545, "gap-frames.jpg": 450}
"""Of sections of which the first row is enough."""

VERDICTS, PATHS, FRAMES = "Will a policy hold?", "Paths", "The same frame, real and simulated"


def main() -> None:
    rehearsal, recordings, into = map(Path, sys.argv[1:])
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": WIDTH_PX, "height": HEIGHT_PX})
        page.goto(recordings.absolute().as_uri())
        draw(page, "h1", f"h2:has-text('{VERDICTS}')", into / "gap-summary.png")
        draw(page, f"h2:text-is('{PATHS}')", "h2:has-text('Errors')", into / "gap-paths.png")
        page.goto(rehearsal.absolute().as_uri())
        draw(page, f"h2:has-text('{VERDICTS}')", ".charts.wide", into / "gap-verdicts.png")
        draw(page, f"h2:has-text('{FRAMES}')", "h2:text-is('Camera')", into / "gap-frames.jpg")


def draw(page: Page, first: str, next_one: str, into: Path) -> None:
    """What stands from one element to before another."""
    tops = [page.locator(name).first.bounding_box() for name in (first, next_one)]
    assert all(tops), (first, next_one)
    begin, end = (box["y"] for box in tops if box)
    tallest = TALLEST_PX.get(into.name, HEIGHT_PX * 2)
    height = min(end - begin, tallest) - MARGIN_PX
    page.screenshot(
        path=into,
        full_page=True,
        clip={"x": 0, "y": begin - MARGIN_PX, "width": WIDTH_PX, "height": height},
    )


if __name__ == "__main__":
    main()
