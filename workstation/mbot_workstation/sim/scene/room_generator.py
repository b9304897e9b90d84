"""A made-up room as a 360-degree picture, for whoever has no photo of the own one.

The room is a box seen from the point where the photo would be taken. For every pixel the ray's
hit with the box is computed; walls, windows, doors, pictures and furniture are then flat
rectangles on those walls. The same seed gives the same room.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.scene.scene_parameters import Room

Colour = tuple[float, float, float]
"""RGB, 0-255."""

CEILING_HEIGHT_M = 2.8
SKIRTING_HEIGHT_M = 0.08
OVERSAMPLING = 2
"""Drawn at twice the size and averaged, against jagged edges."""


@dataclass(frozen=True, slots=True)
class Panel:
    """A flat, upright rectangle on a wall.

    Attributes:
        wall: 0 to 3, starting with the one at +x, counter-clockwise.
        from_m, to_m: along the wall, to the left from its middle.
        bottom_m, top_m: above the floor.
        colour: its base colour.
        stripes: number of boards, drawers or window panes side by side, 1 for a plain surface.
        glow: whether it is lit from behind, as a window.

    """

    wall: int
    from_m: float
    to_m: float
    bottom_m: float
    top_m: float
    colour: Colour
    stripes: int = 1
    glow: bool = False


def generate_room(
    seed: int, width_px: int = 1024, room: Room | None = None, wall_rgb: Colour | None = None
) -> Picture:
    """Draw a room.

    Args:
        seed: which room.
        width_px: width of the picture, a multiple of 4.
        room: where the walls are and from how high it is seen; nominal when None.
        wall_rgb: of the wall at +x; when None it is as the seed says.

    Returns:
        Shape (width_px / 2, width_px, 3), RGB.

    """
    room = room or Room()
    rng = np.random.default_rng(seed)
    width, height = width_px * OVERSAMPLING, width_px // 2 * OVERSAMPLING
    yaw = np.pi * (1 - 2 * (np.arange(width) + 0.5) / width)
    elevation = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    slope = np.tan(elevation)[:, None]

    wall, along_m, range_m = _hit_walls(yaw, room.distance_m)
    height_m = room.photo_height_m + slope * range_m
    picture = _walls(rng, wall, along_m, height_m, wall_rgb)
    for panel in _furnish(rng, room.distance_m):
        _draw(picture, panel, wall, along_m, height_m)
    _draw_floor_and_ceiling(rng, picture, yaw, slope, height_m, room.photo_height_m)
    grain = rng.normal(0, 2.0, picture.shape[:2])[..., None]
    small = cv2.resize(picture + grain, (width_px, width_px // 2), interpolation=cv2.INTER_AREA)
    return np.clip(small, 0, 255).astype(np.uint8)


def _hit_walls(
    yaw: NDArray[np.float64], distance_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """For every column: which wall, where along it [m], and how far away [m]. Shape (w,) each."""
    wall = np.round(yaw / (np.pi / 2)).astype(np.int64) % 4
    offset = (yaw - wall * np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
    return wall, distance_m * np.tan(offset), distance_m / np.cos(offset)


def _walls(
    rng: np.random.Generator,
    wall: NDArray[np.int64],
    along_m: NDArray[np.float64],
    height_m: NDArray[np.float64],
    painted: Colour | None,
) -> NDArray[np.float64]:
    base = rng.uniform(165, 225) + rng.uniform(-14, 14, 3)
    colours = np.clip(base + rng.uniform(-18, 18, (4, 1)), 90, 240)
    if rng.random() < 0.5:  # one wall painted
        colours[rng.integers(4)] = rng.uniform(70, 190, 3)
    if painted is not None:
        colours[0] = painted
    picture = np.repeat(colours[wall][None], height_m.shape[0], axis=0)
    # Corners and the floor's edge get less light.
    corner = np.clip((np.abs(along_m).max() - np.abs(along_m)) / 1.5, 0, 1)
    low = np.clip(height_m / 1.5, 0, 1)
    picture *= (0.78 + 0.12 * corner[None, :] + 0.10 * low)[..., None]
    picture[(height_m < SKIRTING_HEIGHT_M) & (height_m >= 0)] *= 0.55
    return picture


def _furnish(rng: np.random.Generator, distance_m: float) -> list[Panel]:
    """Windows, a door, pictures, then furniture in front of them."""
    panels: list[Panel] = []
    door_wall = int(rng.integers(4))
    for wall in range(4):
        if wall == door_wall:
            left = rng.uniform(-3, 2)
            panels.append(Panel(wall, left, left + 0.95, 0, 2.05, _wood(rng), 1))
        if rng.random() < 0.6:
            glow = (*rng.uniform(215, 235, 2), 245.0)
            for middle in np.linspace(-2.6, 2.6, int(rng.integers(2, 4))):
                panels.append(Panel(wall, middle - 0.7, middle + 0.7, 0.95, 2.2, glow, 3, True))
        else:
            for middle in rng.uniform(-4, 4, 3):
                size = rng.uniform(0.2, 0.5)
                colour = _any(rng)
                panels.append(Panel(wall, middle - size, middle + size, 1.3, 1.3 + size, colour))
        place = -distance_m + rng.uniform(0.2, 0.8)
        while place < distance_m - 1.8:
            width = rng.uniform(0.5, 1.8)
            top = float(rng.choice([0.45, 0.75, 0.85, 1.2, 1.9]))
            bottom = 0.0 if top > 0.8 else float(rng.choice([0.0, 0.12]))
            colour = _wood(rng) if rng.random() < 0.6 else _any(rng)
            panels.append(
                Panel(wall, place, place + width, bottom, top, colour, int(rng.integers(1, 5)))
            )
            place += width + rng.uniform(0.15, 1.6)
    return panels


def _wood(rng: np.random.Generator) -> Colour:
    shade = rng.uniform(0.45, 1.1)
    return (190 * shade, 145 * shade, 100 * shade)


def _any(rng: np.random.Generator) -> Colour:
    red, green, blue = rng.uniform(35, 190, 3)
    # Nothing as red as the object: it must stay distinct, as the paper says.
    return (min(red, green + 40, 140), green, blue)


def _draw(
    picture: NDArray[np.float64],
    panel: Panel,
    wall: NDArray[np.int64],
    along_m: NDArray[np.float64],
    height_m: NDArray[np.float64],
) -> None:
    columns = np.flatnonzero(
        (wall == panel.wall) & (along_m >= panel.from_m) & (along_m < panel.to_m)
    )
    if columns.size == 0:
        return
    heights = height_m[:, columns]
    row, column = np.nonzero((heights >= panel.bottom_m) & (heights < panel.top_m))
    across = (along_m[columns][column] - panel.from_m) / (panel.to_m - panel.from_m)
    up = (heights[row, column] - panel.bottom_m) / (panel.top_m - panel.bottom_m)
    frame = (across < 0.04) | (across > 0.96) | (up < 0.05) | (up > 0.95)
    joint = (across * panel.stripes) % 1.0 < 0.05 * panel.stripes
    light = np.where(panel.glow, 0.9 + 0.1 * up, 0.75 + 0.25 * up)
    light = np.where(frame | joint, light * (0.85 if panel.glow else 0.65), light)
    picture[row, columns[column]] = light[:, None] * np.array(panel.colour)


def _draw_floor_and_ceiling(
    rng: np.random.Generator,
    picture: NDArray[np.float64],
    yaw: NDArray[np.float64],
    slope: NDArray[np.float64],
    height_m: NDArray[np.float64],
    eye_m: float,
) -> None:
    with np.errstate(divide="ignore"):
        range_m = np.where(slope < 0, -eye_m, CEILING_HEIGHT_M - eye_m) / slope
    # Moved a little, so that no joint runs along the picture's own seam.
    x_m, y_m = range_m * np.cos(yaw) + 0.3, range_m * np.sin(yaw) + 0.3
    floor, ceiling = height_m < 0, height_m > CEILING_HEIGHT_M
    boards = np.where((y_m % 0.6) < 0.012, 0.85, 1.0) * (1 - 0.02 * np.floor(y_m / 0.6 % 3))
    picture[floor] = boards[floor][:, None] * (rng.uniform(165, 205) + np.array([6.0, 2.0, -6.0]))
    # Rows of lamps in a light ceiling with square tiles.
    tile = ((x_m % 0.6) < 0.02) | ((y_m % 0.6) < 0.02)
    lamp = ((x_m % 2.4) < 0.6) & ((y_m % 1.8) < 0.6)
    shade = np.where(lamp, 255.0, np.where(tile, 190.0, 222.0))
    picture[ceiling] = shade[ceiling][:, None]
