"""One picture of a run: what the robot saw and did, beside its path from above."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from mbot_protocol.beat.beat import Beat
from mbot_protocol.drive.actions import STEP_LIMIT
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pictures.film_tile import (
    INK,
    TILE_PX,
    Bar,
    blank,
    caption_px,
    draw_tile,
    write,
)
from mbot_workstation.pictures.picture_file import observation

COLUMNS, ROWS = 6, 4
CAPTION_PX = caption_px(bars=2)
GAP_PX = 8
TITLE_PX = 44


def contact_sheet(seen: Sequence[Beat], path: Picture | None, title: str) -> Picture:
    """Arrange up to 24 beats, evenly over the run, and the path.

    Args:
        seen: with pictures.
        path: from `draw_path`; None leaves it out.
        title: one line on top.

    Returns:
        RGB picture.

    """
    height = TITLE_PX + ROWS * (TILE_PX + CAPTION_PX + GAP_PX) + GAP_PX
    width = GAP_PX + COLUMNS * (TILE_PX + GAP_PX)
    sheet = blank(height, width)
    write(sheet, title, (GAP_PX, 28), INK, 0.55)
    count = min(len(seen), COLUMNS * ROWS)
    chosen = [seen[round(k)] for k in np.linspace(0, len(seen) - 1, count)] if count else []
    for number, beat in enumerate(chosen):
        row, column = divmod(number, COLUMNS)
        top = TITLE_PX + row * (TILE_PX + CAPTION_PX + GAP_PX)
        left = GAP_PX + column * (TILE_PX + GAP_PX)
        since_ns = beat.decision.unix_time_ns - seen[0].decision.unix_time_ns
        area = sheet[top : top + TILE_PX + CAPTION_PX, left : left + TILE_PX]
        steps = beat.decision.steps
        bars = [Bar("L", steps.left / STEP_LIMIT), Bar("R", steps.right / STEP_LIMIT)]
        picture = observation(beat)
        shown = blank(64, 64) if picture is None else picture
        draw_tile(area, shown, f"{since_ns / 1e9:.1f} s", bars)
    if path is None:
        return sheet
    beside = blank(height, path.shape[1] + 2 * GAP_PX)
    beside[TITLE_PX : TITLE_PX + path.shape[0], GAP_PX : GAP_PX + path.shape[1]] = path
    return np.hstack([sheet, beside])


def path_side_px() -> int:
    """The side of a path picture that fills the sheet's height."""
    return ROWS * (TILE_PX + CAPTION_PX + GAP_PX)


def save(picture: Picture, path: Path) -> None:
    """Write a PNG.

    Raises:
        ConfigurationError: it can't be written.

    """
    if not cv2.imwrite(str(path), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)):
        raise ConfigurationError(f"can't write the picture {path}")
