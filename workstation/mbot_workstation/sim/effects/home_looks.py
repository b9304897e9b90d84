"""Rooms that people live in: what stands and hangs about, floors that mirror, light that blinds.

Things have the object's own colour as often as not: whoever goes by colour drives to them. Ranges
are assumed, by somebody who had seen the path-traced pictures of docs/notebook/training.md and what
policies made of them: to that person they are no test.
"""

import colorsys
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mbot_workstation.sim.effects.scene_looks import (
    ARENA_M,
    FLAT_M,
    MADE_UP_FLOORS,
    colour_of,
    draw_look,
    its_colour,
    nearly_an_object,
    unlike_an_object,
)
from mbot_workstation.sim.scene.finishes import FINISHES
from mbot_workstation.sim.scene.floor_textures import HOME_KINDS
from mbot_workstation.sim.scene.scene_look import Distractor, ObjectLook, SceneLook, Standing
from mbot_workstation.sim.scene.target_object import Rgb, Shape, TargetObject
from mbot_workstation.sim.scene.things import LARGE, SMALL, Make, Thing

MOST_STANDING = 7
"""Things inside the arena; one of five arenas has none."""

MOST_ALONG_WALLS = 5
MOST_PIECES = 46
"""Of all things: twice as many are drawn where the floor mirrors them."""

ITS_COLOUR, NATURAL = 0.5, 0.4
"""Share of things that have the object's colour; of the others, that of wood, cardboard or clay."""

WOODEN = ("carton", "cupboard")
"""Half of these, which have its colour else, and all others of them look like wood or cardboard."""

FROM_START_M = 0.5
"""No thing stands nearer to where the robot begins, beside its own radius."""

FREE = 0.5
"""Share of homes without boards around the arena."""

ALIKE = {
    Shape.CUBE: ("block",),
    Shape.BALL: ("ball",),
    Shape.CYLINDER: ("can", "bottle", "cup", "bin"),
    Shape.MESH: ("bottle", "can"),
}
"""What can't be told from an object of this shape by its own: never in the object's colour."""


def draw_home(rng: np.random.Generator, objects: Sequence[TargetObject]) -> SceneLook:
    """A home: an arena of any look with all of that besides."""
    look = draw_look(rng, objects, lookalikes=0.3)
    lamp = max(0.0, rng.uniform(-0.6, 0.45))  # more than half by daylight
    warmth = np.array((1 + 0.5 * lamp, 1.0, 1 - lamp))
    dim = rng.uniform(0.5, 1.0)
    direct = np.array(look.light_rgb) * warmth
    worn = tuple(_object_look(rng, *one) for one in zip(objects, look.objects, strict=True))
    look = replace(look, objects=worn)
    pieces, standing = _things(rng, objects, look)
    return replace(
        look,
        floor=int(rng.integers(MADE_UP_FLOORS + HOME_KINDS + 1)),
        floor_mirrors=0.0 if rng.random() < 0.55 else rng.uniform(0.05, 0.5),
        wall_height_m=0.0 if rng.random() < FREE else look.wall_height_m,
        wall_rgb=_natural(rng) if rng.random() < 0.25 else look.wall_rgb,
        light_rgb=_rgb(direct * dim),
        ambient_rgb=_rgb(np.array(look.ambient_rgb) * warmth * dim),
        room_rgb=_rgb(warmth * rng.choice([1.0, dim])),
        distractors=pieces,
        standing=standing,
    )


def _object_look(rng: np.random.Generator, thing: TargetObject, worn: ObjectLook) -> ObjectLook:
    """Of any finish, labelled now and then."""
    rgb = colour_of(thing, *_red(rng))
    return replace(worn, rgb=rgb, wear=_finish(rng), labelled=bool(rng.random() < 0.15))


def _red(rng: np.random.Generator) -> tuple[float, float, float]:
    """Hue, saturation and value of a red: mostly of a pure one, else of rose, brick or a dark one.

    The object and what is like it are drawn alike: a colour that only one of them has would tell
    them apart.
    """
    if rng.random() < 0.6:
        return rng.uniform(-0.03, 0.025), rng.uniform(0.72, 0.97), rng.uniform(0.5, 0.95)
    return rng.uniform(-0.05, 0.035), rng.uniform(0.55, 1.0), rng.uniform(0.35, 1.0)


def _alike(rng: np.random.Generator, objects: Sequence[TargetObject], look: SceneLook) -> Rgb:
    """The colour that an object has in this home, nearly, or another that it might have."""
    kind = int(rng.integers(len(objects)))
    if objects[kind].is_plain and rng.random() < 0.5:
        return _rgb(np.array(look.objects[kind].rgb) * rng.uniform(0.9, 1.1))
    return its_colour(objects[kind], *_red(rng))


def _finish(rng: np.random.Generator) -> int:
    """Clean as often as any other."""
    return int(rng.integers(FINISHES)) if rng.random() < 0.6 else 0


def _things(
    rng: np.random.Generator, objects: Sequence[TargetObject], look: SceneLook
) -> tuple[tuple[Distractor, ...], tuple[Standing, ...]]:
    """Everything but the object, and what of it is in a robot's way."""
    pieces = _patches(rng)
    standing: list[Standing] = []
    for _ in range(max(0, int(rng.integers(-1, MOST_STANDING + 1)))):
        name, thing, is_alike = _drawn(rng, objects, look, SMALL)
        x, y = (rng.choice([1.0, 0.6]) * rng.uniform(-2.6, 2.6, 2)).tolist()
        room = MOST_PIECES - len(pieces) - len(thing.parts) - 1  # its shadow
        if room < 0 or math.hypot(x, y) < FROM_START_M + thing.radius_m:
            continue
        standing.append(Standing(name, x, y, thing.radius_m, thing.height_m, is_alike))
        pieces += _placed(rng, thing, x, y, look)
    for _ in range(int(rng.integers(MOST_ALONG_WALLS + 1))):
        _, thing, _ = _drawn(rng, objects, look, LARGE if rng.random() < 0.6 else SMALL)
        angle = rng.uniform(-math.pi, math.pi)
        to_border = ARENA_M / max(abs(math.cos(angle)), abs(math.sin(angle)))
        away = min(to_border + thing.radius_m + rng.uniform(0.05, 1.2), 4.7)
        up = rng.uniform(0.3, 1.0) if thing.height_m < 0.4 and rng.random() < 0.2 else 0.0
        pieces += _placed(
            rng, thing, away * math.cos(angle), away * math.sin(angle), look, up, angle + math.pi
        )
    pieces += [piece for piece in look.distractors if rng.random() < 0.3]
    return tuple(pieces[:MOST_PIECES]), tuple(standing)


def _placed(
    rng: np.random.Generator,
    thing: Thing,
    x_m: float,
    y_m: float,
    look: SceneLook,
    up_m: float = 0.0,
    yaw_rad: float | None = None,
) -> list[Distractor]:
    """A thing and, where objects cast one, its shadow."""
    yaw = rng.uniform(-math.pi, math.pi) if yaw_rad is None else yaw_rad + rng.normal(0, 0.2)
    # What is of one colour has a surface as the object has: that does not tell them apart.
    finish, main = _finish(rng), thing.parts[0].rgb
    pieces = [
        replace(piece, finish=finish) if piece.rgb == main and not piece.finish else piece
        for piece in thing.at(x_m, y_m, yaw, up_m)
    ]
    if look.shadow > 0 and up_m == 0:
        reach, heading = look.shadow_of(thing.height_m)
        half = 1.05 * thing.radius_m
        place = (x_m + reach / 2 * math.cos(heading), y_m + reach / 2 * math.sin(heading), 5e-4)
        size = (half + reach / 2, half, 5e-4)
        pieces.append(Distractor("box", size, place, heading, (0.0, 0.0, 0.0), opacity=look.shadow))
    return pieces


def _patches(rng: np.random.Generator) -> list[Distractor]:
    """Sun on the floor, and shade."""
    made: list[Distractor] = []
    for _ in range(int(rng.choice([0, 0, 0, 1, 2]))):
        x, y = rng.uniform(-2.5, 2.5, 2).tolist()
        size = (rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.6), FLAT_M / 4)
        rgb, opacity = ((1.0, 0.97, 0.88), 0.65) if rng.random() < 0.6 else ((0.0, 0.0, 0.0), 0.35)
        yaw = rng.uniform(0, math.pi)
        made.append(Distractor("box", size, (x, y, FLAT_M / 4), yaw, rgb, opacity=opacity))
    return made


def _drawn(
    rng: np.random.Generator,
    objects: Sequence[TargetObject],
    look: SceneLook,
    kinds: Mapping[str, Make],
) -> tuple[str, Thing, bool]:
    """A thing, what it is called, and whether it has an object's colour."""
    name = str(rng.choice(list(kinds)))
    is_alike = rng.random() < ITS_COLOUR and not any(name in ALIKE[one.shape] for one in objects)
    if is_alike and name in WOODEN:
        is_alike = bool(rng.random() < 0.5)
    colour = _alike(rng, objects, look) if is_alike else _other_colour(rng, objects, name)
    return name, kinds[name](rng, colour), is_alike


def _other_colour(rng: np.random.Generator, objects: Sequence[TargetObject], name: str) -> Rgb:
    if name in WOODEN or rng.random() < NATURAL:
        return _natural(rng)
    if rng.random() < 0.4:
        return nearly_an_object(rng, objects)
    return unlike_an_object(rng, objects)


def _natural(rng: np.random.Generator) -> Rgb:
    """Wood, cardboard, leather, brick, clay."""
    clay = rng.random() < 0.3
    hue = rng.uniform(0.042, 0.06) if clay else rng.uniform(0.05, 0.11)
    return colorsys.hsv_to_rgb(
        hue, rng.uniform(0.45, 0.66) if clay else rng.uniform(0.2, 0.65), rng.uniform(0.15, 0.85)
    )


def _rgb(values: np.ndarray) -> Rgb:
    red, green, blue = np.clip(values, 0, 1).tolist()
    return red, green, blue
