"""What the robot saw and what its wheels were told, as a small picture: for strips and sheets."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture

TILE_PX = 128
LINE_PX = 12
GAP_PX = 8
TITLE_PX = 40
INK, FAINT, PAPER = (40, 40, 40), (150, 150, 150), (250, 250, 248)
FORWARD, BACKWARD = (20, 130, 60), (200, 90, 20)


@dataclass(frozen=True, slots=True)
class Bar:
    """One wheel below a picture: its name, and its share of full speed in [-1, 1]."""

    name: str
    share: float


def wheel_bars(told: tuple[float, float]) -> tuple[Bar, Bar]:
    """Both wheels as they were told."""
    return Bar("L", told[0]), Bar("R", told[1])


def caption_px(bars: int) -> int:
    """How much a tile with so many bars is higher than its picture."""
    return 10 + LINE_PX * bars


def draw_tile(area: Picture, observation: Picture, words: str, bars: Sequence[Bar]) -> None:
    """Draw a picture, enlarged without smoothing, some words and bars below it.

    Args:
        area: drawn upon; shape (TILE_PX + caption_px(bars), TILE_PX, 3), RGB.
        observation: what the policy saw, RGB.
        words: beside the bars, such as "2.4 s".
        bars: one a line.

    """
    area[:TILE_PX] = cv2.resize(observation, (TILE_PX, TILE_PX), interpolation=cv2.INTER_NEAREST)
    write(area, words, (2, TILE_PX + 14), INK, 0.4)
    middle = TILE_PX * 2 // 3
    for line, bar in enumerate(bars):
        y = TILE_PX + 9 + LINE_PX * line
        write(area, bar.name, (middle - 48, y + 4), FAINT, 0.35)
        cv2.line(area, (middle - 36, y), (middle + 36, y), (220, 220, 216), 1)
        end = (middle + round(36 * max(-1.0, min(1.0, bar.share))), y)
        cv2.line(area, (middle, y), end, FORWARD if bar.share >= 0 else BACKWARD, 5)


@dataclass(frozen=True, slots=True)
class Tile:
    """What `draw_tile` takes."""

    observation: Picture
    words: str
    bars: tuple[Bar, ...]


def strip_of(tiles: Sequence[Tile], columns: int, title: str = "") -> Picture:
    """Tiles side by side, row after row; shape (height, width, 3), RGB."""
    title_px = TITLE_PX if title else GAP_PX
    tile_px = TILE_PX + caption_px(max((len(tile.bars) for tile in tiles), default=0))
    rows = -(-len(tiles) // columns)
    sheet = blank(title_px + rows * (tile_px + GAP_PX), GAP_PX + columns * (TILE_PX + GAP_PX))
    # OpenCV's letters are ASCII.
    write(sheet, title.encode("ascii", "replace").decode(), (GAP_PX, 26), INK, 0.5)
    for number, tile in enumerate(tiles):
        row, column = divmod(number, columns)
        top = title_px + row * (tile_px + GAP_PX)
        left = GAP_PX + column * (TILE_PX + GAP_PX)
        area = sheet[top : top + tile_px, left : left + TILE_PX]
        draw_tile(area, tile.observation, tile.words, tile.bars)
    return sheet


def write(
    area: Picture, text: str, at: tuple[int, int], colour: tuple[int, int, int], size: float
) -> None:
    """A line of text; `at` is its lower left corner in pixels."""
    cv2.putText(area, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)


def blank(height_px: int, width_px: int) -> Picture:
    """Paper to draw on."""
    return np.full((height_px, width_px, 3), PAPER, np.uint8)
