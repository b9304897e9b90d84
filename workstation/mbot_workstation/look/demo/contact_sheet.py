"""One picture of a run: what the robot saw and did, beside its path from above."""

from collections.abc import Sequence

import numpy as np

from mbot_protocol.beat.beat import Beat
from mbot_protocol.drive.picture import Picture
from mbot_workstation.pictures.film_tile import (
    GAP_PX,
    TILE_PX,
    TITLE_PX,
    Tile,
    blank,
    caption_px,
    strip_of,
    wheel_bars,
)
from mbot_workstation.pictures.picture_file import observation

COLUMNS, ROWS = 6, 4


def contact_sheet(seen: Sequence[Beat], path: Picture | None, title: str) -> Picture:
    """Arrange up to 24 beats, evenly over the run, and the path.

    Args:
        seen: with pictures.
        path: from `draw_path`; None leaves it out.
        title: one line on top.

    Returns:
        RGB picture.

    """
    count = min(len(seen), COLUMNS * ROWS)
    tiles: list[Tile] = []
    for k in np.linspace(0, len(seen) - 1, count):
        beat = seen[round(k)]
        since_ns = beat.decision.unix_time_ns - seen[0].decision.unix_time_ns
        picture, words = observation(beat), f"{since_ns / 1e9:.1f} s"
        shown = blank(64, 64) if picture is None else picture
        tiles.append(Tile(shown, words, wheel_bars(beat.at_wheels())))
    strip = strip_of(tiles, COLUMNS, title)
    sheet = blank(TITLE_PX + path_side_px(), strip.shape[1])
    sheet[: strip.shape[0]] = strip
    if path is None:
        return sheet
    beside = blank(sheet.shape[0], path.shape[1] + 2 * GAP_PX)
    beside[TITLE_PX : TITLE_PX + path.shape[0], GAP_PX : GAP_PX + path.shape[1]] = path
    return np.hstack([sheet, beside])


def path_side_px() -> int:
    """The side of a path picture that fills the sheet's height."""
    return ROWS * (TILE_PX + caption_px(bars=2) + GAP_PX)
