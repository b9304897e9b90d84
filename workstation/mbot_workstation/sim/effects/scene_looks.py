"""Arenas as they may look anywhere: floors, boards, light, other reds, and things that are not it.

Ranges are assumptions about homes, schools and offices, made by somebody who had seen twenty of the
labelled pictures of docs/notebook/lesson-10.md: to that person they are no test.
"""

import colorsys
import math
from collections.abc import Callable, Sequence

import numpy as np

from mbot_workstation.sim.scene.floor_textures import (
    HOME_KINDS,
    FloorTexture,
    home_floor,
    made_up_floor,
)
from mbot_workstation.sim.scene.scene_look import Distractor, ObjectLook, SceneLook
from mbot_workstation.sim.scene.target_object import RED_CUBE, Rgb, Shape, TargetObject

MADE_UP_FLOORS = 24
"""Four of each kind, besides the vinyl; tints make more of them."""

NO_WALL = 0.1
"""Share of arenas without boards; few, since the border is not seen there."""

FLAT_M = 0.004
"""How high something flat lies; lower would not be told from the floor by the depth buffer."""

SIZES = (0.8, 1.2)
"""Of the object, over its own: from a fifth smaller to a fifth larger."""

MOST_AROUND = 5
"""Things that are not the object, in such an arena."""

WORN = 3
"""Finishes of the object: clean, and two that are worn."""

MOST_DRAWS = 20
"""Of a colour that several objects must not have."""

ARENA_M = 3.0
"""Where the boards stand."""

OTHER_HUES = 0.1, 0.88
"""Of things that are not the object, a red one: from orange round to magenta."""

BOARD_HUES = 0.04, 0.92
"""Of coloured boards, likewise."""

NEARLY = 0.08
"""How near to the ends of these a lookalike's hue is; assumed, after a policy had taken things of
hues 0.83 to 0.88 for the object.
"""


def training_floors(first_seed: int = 1000) -> list[FloorTexture]:
    """The made-up floors of `draw_look`, which take the indices from 1 on, and those of homes."""
    made_up = [made_up_floor(first_seed + number) for number in range(MADE_UP_FLOORS)]
    return [*made_up, *(home_floor(first_seed + number) for number in range(HOME_KINDS))]


def draw_look(
    rng: np.random.Generator,
    objects: Sequence[TargetObject] = (RED_CUBE,),
    lookalikes: float = 0.0,
) -> SceneLook:
    """An arena that looks like any, for these kinds of object.

    What is drawn for a red cube is drawn for any other: reds become as many kinds of its colour,
    and what is of any colour but red is of any colour but its.

    Args:
        rng: of all that is drawn.
        objects: the kinds.
        lookalikes: share of the things that are not it which have its size and nearly its colour,
            and of coloured boards which have nearly its colour.

    """
    ambient = rng.uniform(0.35, 0.95)
    direct = rng.uniform(0.1, 0.9) * (1.15 - ambient)
    warmth = rng.uniform(-0.12, 0.12)
    colour = np.array((1 + warmth, 1.0, 1 - warmth))
    slant, azimuth = rng.uniform(0.1, 1.6), rng.uniform(-math.pi, math.pi)
    return SceneLook(
        floor=int(rng.integers(MADE_UP_FLOORS + 1)),
        floor_tint=_rgb(rng.uniform(0.55, 1.1) * (1 + rng.uniform(-0.08, 0.08, 3))),
        floor_gloss=float(rng.choice([0.0, 0.0, rng.uniform(0.1, 0.6)])),
        wall_height_m=0.0 if rng.random() < NO_WALL else rng.uniform(0.08, rng.choice([0.3, 0.6])),
        wall_rgb=_board_colour(rng, objects, lookalikes),
        foot_height_m=float(rng.choice([0.0, rng.uniform(0.01, 0.06)])),
        foot_rgb=_rgb(rng.uniform(0.03, 0.4) * (1 + rng.uniform(-0.2, 0.2, 3))),
        objects=tuple(_object_look(rng, thing) for thing in objects),
        light_direction=(slant * math.cos(azimuth), slant * math.sin(azimuth), -1.0),
        light_rgb=_rgb(direct * colour),
        ambient_rgb=_rgb(ambient * (2 - colour)),
        shadow=float(rng.choice([0.0, rng.uniform(0.1, 0.6)])),
        distractors=tuple(
            _distractor(rng, objects, lookalikes) for _ in range(rng.integers(MOST_AROUND + 1))
        ),
    )


def _object_look(rng: np.random.Generator, thing: TargetObject) -> ObjectLook:
    """A fifth smaller to a fifth larger; a red one from crimson to vermilion, dark to bright."""
    scale = rng.uniform(*SIZES)
    hue, saturation, value = (
        rng.uniform(-0.030, 0.025), rng.uniform(0.72, 0.97), rng.uniform(0.5, 0.95)
    )  # fmt: skip
    return ObjectLook(
        rgb=colour_of(thing, hue, saturation, value),
        scale=1.0 if thing.shape is Shape.MESH else scale,
        wear=int(rng.integers(WORN)),
    )


def colour_of(thing: TargetObject, hue: float, saturation: float, value: float) -> Rgb:
    """What a red, of the red cube, is of another object, as its pictures are tinted."""
    return _tint(thing, its_colour(thing, hue, saturation, value))


def its_colour(thing: TargetObject, hue: float, saturation: float, value: float) -> Rgb:
    """A red, of the red cube, turned into the like of another object's colour."""
    its, red = thing.mean_hsv, RED_CUBE.mean_hsv
    return colorsys.hsv_to_rgb(
        (hue + (its[0] - red[0])) % 1.0,
        min(1.0, saturation * (its[1] / red[1])),
        min(1.0, value * (its[2] / red[2])),
    )


def _tint(thing: TargetObject, seen: Rgb) -> Rgb:
    """What its pictures have to be multiplied with, so that it looks like this on the whole."""
    if thing.is_plain:
        return seen
    plain = colorsys.hsv_to_rgb(*thing.mean_hsv)
    return _rgb(np.array(thing.rgb) * seen / np.maximum(plain, 0.05))


def _board_colour(
    rng: np.random.Generator, objects: Sequence[TargetObject], lookalikes: float
) -> Rgb:
    """Mostly light and greyish; now and then wood, black or a colour."""
    if rng.random() < 0.7:
        return _rgb(rng.uniform(0.4, 0.98) * (1 + rng.uniform(-0.1, 0.1, 3)))
    hue = _other_hue(rng, objects, BOARD_HUES, lookalikes)
    return colorsys.hsv_to_rgb(hue, rng.uniform(0, 0.7), rng.uniform(0.08, 0.9))


def _distractor(
    rng: np.random.Generator, objects: Sequence[TargetObject], lookalikes: float
) -> Distractor:
    """Of the object's colour but not its shape or place, or of any shape and other colours."""
    if lookalikes > 0 and rng.random() < lookalikes:
        return _of_its_size(rng, objects, nearly_an_object)
    kind = rng.integers(4)
    if kind == 0:
        return _on_the_wall(rng, objects)
    if kind == 1:
        return _on_the_floor(rng, objects)
    if kind == 2:
        return _behind_the_wall(rng, objects)
    return _of_its_size(rng, objects, unlike_an_object)


def _on_the_wall(rng: np.random.Generator, objects: Sequence[TargetObject]) -> Distractor:
    """A poster, a box, a coat: of its colour, above the floor, outside the arena."""
    angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(ARENA_M * 1.45, ARENA_M * 1.6)
    bottom, height = rng.uniform(0.35, 1.2), rng.uniform(0.15, 0.7)
    size = (0.02, rng.uniform(0.08, 0.5), height / 2)
    place = (away * math.cos(angle), away * math.sin(angle), bottom + height / 2)
    return Distractor("box", size, place, angle, like_an_object(rng, objects))


def _on_the_floor(rng: np.random.Generator, objects: Sequence[TargetObject]) -> Distractor:
    """Paper, tape, a mat: flat, so that a robot can drive over it."""
    x, y = rng.uniform(-2.6, 2.6, 2)
    size = (rng.uniform(0.03, 0.5), rng.uniform(0.01, 0.12), FLAT_M / 2)
    colour = like_an_object(rng, objects) if rng.random() < 0.5 else unlike_an_object(rng, objects)
    return Distractor(
        "box", size, (float(x), float(y), FLAT_M / 2), rng.uniform(0, math.pi), colour
    )


def _behind_the_wall(rng: np.random.Generator, objects: Sequence[TargetObject]) -> Distractor:
    """Chairs' legs, bottles, balls, cupboards: standing where no robot gets to."""
    angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(ARENA_M * 1.45, ARENA_M * 1.6)
    place = away * math.cos(angle), away * math.sin(angle)
    colour = like_an_object(rng, objects) if rng.random() < 0.6 else unlike_an_object(rng, objects)
    if rng.random() < 0.5:
        radius, half = rng.uniform(0.015, 0.05), rng.uniform(0.3, 0.9)
        return Distractor("post", (radius, radius, half), (*place, half), 0.0, colour)
    half = rng.uniform(0.35, 0.9)
    return Distractor("box", (0.05, rng.uniform(0.05, 0.5), half), (*place, half), angle, colour)


def _of_its_size(
    rng: np.random.Generator,
    objects: Sequence[TargetObject],
    colour: Callable[[np.random.Generator, Sequence[TargetObject]], Rgb],
) -> Distractor:
    """A cube or a ball of the object's size, but of another colour; outside the arena."""
    angle = rng.uniform(-math.pi, math.pi)
    to_border = ARENA_M / max(abs(math.cos(angle)), abs(math.sin(angle)))
    away = to_border * rng.uniform(1.02, 1.3)
    half = rng.uniform(0.04, 0.12)
    shape = "box" if rng.random() < 0.6 else "ball"
    place = (away * math.cos(angle), away * math.sin(angle), half)
    yaw_rad = rng.uniform(0, math.pi)
    return Distractor(shape, (half, half, half), place, yaw_rad, colour(rng, objects))


def like_an_object(rng: np.random.Generator, objects: Sequence[TargetObject]) -> Rgb:
    """A colour like an object's, more loosely than its own."""
    thing = objects[int(rng.integers(len(objects))) if len(objects) > 1 else 0]
    return its_colour(thing, rng.uniform(-0.05, 0.05), rng.uniform(0.5, 1.0), rng.uniform(0.3, 1.0))


def unlike_an_object(rng: np.random.Generator, objects: Sequence[TargetObject]) -> Rgb:
    """Any colour that no object has, or, of many objects, hardly any."""
    hue = _other_hue(rng, objects, OTHER_HUES)
    return colorsys.hsv_to_rgb(hue, rng.uniform(0, 1.0), rng.uniform(0.1, 0.95))


def nearly_an_object(rng: np.random.Generator, objects: Sequence[TargetObject]) -> Rgb:
    """One of those that are most like an object's: orange or magenta, for a red one."""
    hue = _other_hue(rng, objects, OTHER_HUES, lookalikes=1.0)
    return colorsys.hsv_to_rgb(hue, rng.uniform(0.4, 1.0), rng.uniform(0.1, 0.95))


def _other_hue(
    rng: np.random.Generator,
    objects: Sequence[TargetObject],
    ends: tuple[float, float],
    lookalikes: float = 0.0,
) -> float:
    """A hue as far from the objects' as these ends are from red's; of lookalikes, near an end."""
    low, high = ends
    if lookalikes > 0 and rng.random() < lookalikes:  # without any, it draws what it always drew
        low, high = (low, low + NEARLY) if rng.random() < 0.5 else (high - NEARLY, high)
    turns = [thing.mean_hsv[0] - RED_CUBE.mean_hsv[0] for thing in objects]
    hue = 0.0
    for _ in range(MOST_DRAWS):
        hue = (rng.uniform(low, high) + turns[0]) % 1.0
        if all(ends[0] <= (hue - turn) % 1.0 <= ends[1] for turn in turns[1:]):
            break
    return hue


def _rgb(values: np.ndarray) -> Rgb:
    red, green, blue = np.clip(values, 0, 1).tolist()
    return red, green, blue
