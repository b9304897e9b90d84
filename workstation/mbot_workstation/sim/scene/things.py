"""What lies about in homes, of boxes, balls, eggs and posts: cans, shoes, pots, chairs.

Sizes are of common things, drawn a little larger or smaller; all stand in the origin, on the floor.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.sim.scene.target_object import Rgb

Point = tuple[float, float, float]

WHITE, PAPER, DARK, METAL, LEAF = (
    (0.93, 0.93, 0.92), (0.9, 0.87, 0.78), (0.08, 0.08, 0.09), (0.62, 0.63, 0.65), (0.2, 0.42, 0.16)
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Thing:
    """One thing, about the origin.

    Attributes:
        parts: what it consists of.
        radius_m: of the circle in which it stands.
        height_m: of its top.

    """

    parts: tuple[Distractor, ...]
    radius_m: float
    height_m: float

    def at(self, x_m: float, y_m: float, yaw_rad: float, up_m: float = 0.0) -> list[Distractor]:
        """Its parts, put there."""
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)

        def placed(part: Distractor) -> Distractor:
            x, y, z = part.centre_m
            centre_m = (x_m + cos * x - sin * y, y_m + sin * x + cos * y, up_m + z)
            return replace(part, centre_m=centre_m, yaw_rad=yaw_rad + part.yaw_rad)

        return [placed(part) for part in self.parts]


Make = Callable[[np.random.Generator, Rgb], Thing]


def _box(half: Point, centre: Point, rgb: Rgb, finish: int = 0) -> Distractor:
    return Distractor("box", half, centre, 0.0, rgb, finish=finish)


def _post(radius: float, half: float, centre: Point, rgb: Rgb, tilt: float = 0.0) -> Distractor:
    return Distractor("post", (radius, radius, half), centre, 0.0, rgb, tilt_rad=tilt)


def _egg(half: Point, centre: Point, rgb: Rgb) -> Distractor:
    return Distractor("egg", half, centre, 0.0, rgb)


def _ball(rng: np.random.Generator, rgb: Rgb) -> Thing:
    r = float(rng.choice([rng.uniform(0.03, 0.06), rng.uniform(0.06, 0.12)]))
    return Thing((Distractor("ball", (r, r, r), (0, 0, r), 0.0, rgb),), r, 2 * r)


def _can(rng: np.random.Generator, rgb: Rgb) -> Thing:
    s = rng.uniform(0.9, 1.25)
    r, half = 0.033 * s, 0.058 * s
    if rng.random() < 0.15:  # fallen over
        return Thing((_post(r, half, (0, 0, r), rgb, math.pi / 2),), half, 2 * r)
    parts = [_post(r, half, (0, 0, half), rgb), _post(0.9 * r, 0.002, (0, 0, 2 * half), METAL)]
    if rng.random() < 0.5:
        band = half * rng.uniform(0.15, 0.4)
        parts.append(_post(1.01 * r, band, (0, 0, half * rng.uniform(0.7, 1.3)), WHITE))
    return Thing(tuple(parts), r, 2 * half)


def _bottle(rng: np.random.Generator, rgb: Rgb) -> Thing:
    s = rng.uniform(0.8, 1.2)
    r, body = 0.036 * s, 0.085 * s
    top = 2 * body
    parts = [
        _post(r, body, (0, 0, body), rgb),
        _egg((r, r, 0.04 * s), (0, 0, top), rgb),
        _post(0.35 * r, 0.025 * s, (0, 0, top + 0.05 * s), rgb),
        _post(0.42 * r, 0.009 * s, (0, 0, top + 0.08 * s), WHITE if rng.random() < 0.6 else DARK),
    ]
    if rng.random() < 0.4:
        parts.append(_post(1.01 * r, 0.35 * body, (0, 0, body), PAPER))
    return Thing(tuple(parts), r, top + 0.09 * s)


def _cup(rng: np.random.Generator, rgb: Rgb) -> Thing:
    s = rng.uniform(0.85, 1.3)
    r, half = 0.041 * s, 0.048 * s
    inside = DARK if rng.random() < 0.5 else WHITE
    parts = [_post(r, half, (0, 0, half), rgb), _post(0.88 * r, 0.001, (0, 0, 2 * half), inside)]
    if rng.random() < 0.7:
        ear = (0.016 * s, 0.006 * s, 0.6 * half)
        parts.append(_box(ear, (1.3 * r, 0, half), rgb))
    return Thing(tuple(parts), 1.4 * r, 2 * half)


def _shoe(rng: np.random.Generator, rgb: Rgb) -> Thing:
    s = rng.uniform(0.75, 1.15)
    sole = WHITE if rng.random() < 0.6 else DARK
    return Thing(
        (
            _egg((0.13 * s, 0.048 * s, 0.012 * s), (0, 0, 0.010 * s), sole),
            _egg((0.125 * s, 0.043 * s, 0.042 * s), (0, 0, 0.032 * s), rgb),
            _egg((0.06 * s, 0.04 * s, 0.05 * s), (-0.06 * s, 0, 0.055 * s), rgb),
            _egg((0.035 * s, 0.028 * s, 0.02 * s), (-0.065 * s, 0, 0.095 * s), DARK),
        ),
        0.12 * s,
        0.1 * s,
    )


def _book(rng: np.random.Generator, rgb: Rgb) -> Thing:
    x, y, z = rng.uniform(0.08, 0.14), rng.uniform(0.06, 0.1), rng.uniform(0.006, 0.022)
    if rng.random() < 0.15:  # standing
        return Thing(
            (
                _box((x, z, y), (0, 0, y), rgb),
                _box((0.97 * x, 0.8 * z, y), (0.05 * x, 0, y + 0.002), PAPER),
            ),
            x,
            2 * y,
        )
    pages = _box((0.98 * x, 0.98 * y, 0.75 * z), (0.04 * x, 0.04 * y, z), PAPER)
    return Thing((_box((x, y, z), (0, 0, z), rgb, int(rng.integers(8))), pages), x, 2 * z)


def _cap(rng: np.random.Generator, rgb: Rgb) -> Thing:
    s = rng.uniform(0.9, 1.15)
    brim = _egg((0.065 * s, 0.065 * s, 0.006), (0.11 * s, 0, 0.012), rgb)
    return Thing((_egg((0.09 * s, 0.085 * s, 0.1 * s), (0, 0, 0), rgb), brim), 0.12 * s, 0.1 * s)


def _car(rng: np.random.Generator, rgb: Rgb) -> Thing:
    s = rng.uniform(0.7, 1.4)
    wheels = tuple(
        Distractor("egg", (0.016 * s, 0.007 * s, 0.016 * s), (x * s, y * s, 0.016 * s), 0.0, DARK)
        for x in (-0.045, 0.045)
        for y in (-0.036, 0.036)
    )
    cabin = _box((0.035 * s, 0.03 * s, 0.016 * s), (-0.01 * s, 0, 0.062 * s), rgb)
    windows = _box((0.036 * s, 0.026 * s, 0.010 * s), (-0.01 * s, 0, 0.062 * s), DARK)
    body = _box((0.08 * s, 0.036 * s, 0.018 * s), (0, 0, 0.03 * s), rgb)
    return Thing((body, cabin, windows, *wheels), 0.08 * s, 0.08 * s)


def _bag(rng: np.random.Generator, rgb: Rgb) -> Thing:
    x, y, z = rng.uniform(0.1, 0.2), rng.uniform(0.06, 0.12), rng.uniform(0.1, 0.2)
    parts = [
        _egg((x, y, z), (0, 0, 0.9 * z), rgb),
        _box((0.6 * x, 0.8 * y, 0.02), (0, 0, 0.02), rgb),
    ]
    parts.append(_box((0.5 * x, 0.008, 0.012), (0, 0, 1.95 * z), DARK))
    return Thing(tuple(parts), x, 2 * z)


def _cushion(rng: np.random.Generator, rgb: Rgb) -> Thing:
    a, z = rng.uniform(0.15, 0.25), rng.uniform(0.05, 0.09)
    if rng.random() < 0.5:
        return Thing((_egg((a, a, z), (0, 0, z), rgb),), a, 2 * z)
    tilt = rng.uniform(0.15, 0.5)  # leaning
    leaning = Distractor("egg", (z, a, a), (0, 0, 0.95 * a), 0.0, rgb, tilt_rad=-tilt)
    return Thing((leaning,), a, 2 * a)


def _pot(rng: np.random.Generator, rgb: Rgb) -> Thing:
    r, h = rng.uniform(0.06, 0.16), rng.uniform(0.1, 0.3)
    parts = [
        _post(0.8 * r, 0.25 * h, (0, 0, 0.25 * h), rgb),
        _post(0.92 * r, 0.2 * h, (0, 0, 0.68 * h), rgb),
        _post(r, 0.08 * h, (0, 0, 0.92 * h), rgb),
    ]
    top = h
    if rng.random() < 0.7:
        shade = rng.uniform(0.5, 1.2)
        leaf = (LEAF[0] * shade, LEAF[1] * shade, LEAF[2] * shade)
        tall = rng.uniform(0.1, 0.5)
        parts.append(_egg((1.2 * r, 1.2 * r, tall / 2), (0, 0, h + 0.4 * tall), leaf))
        top = h + 0.9 * tall
    return Thing(tuple(parts), r, top)


def _carton(rng: np.random.Generator, rgb: Rgb) -> Thing:
    x, y, z = (float(one) for one in rng.uniform(0.04, rng.choice([0.1, 0.22]), 3))
    parts = [_box((x, y, z), (0, 0, z), rgb, int(rng.choice([0, 5, 5, 6, 7])))]
    if rng.random() < 0.6:
        tape = (rgb[0] * 0.9, rgb[1] * 0.85, rgb[2] * 0.7)
        parts.append(_box((1.004 * x, 0.15 * y, 1.004 * z), (0, 0, z), tape))
    return Thing(tuple(parts), math.hypot(x, y) * 0.85, 2 * z)


def _block(rng: np.random.Generator, rgb: Rgb) -> Thing:
    half = rng.uniform(0.03, 0.075)
    box = _box((half, half, half), (0, 0, half), rgb, int(rng.integers(8)))
    return Thing((box,), 1.15 * half, 2 * half)


def _chair(rng: np.random.Generator, rgb: Rgb) -> Thing:
    half, seat, leg = rng.uniform(0.18, 0.24), rng.uniform(0.3, 0.48), rng.uniform(0.012, 0.025)
    frame = rgb if rng.random() < 0.4 else METAL if rng.random() < 0.6 else DARK
    legs = tuple(
        _post(leg, seat / 2, (0.85 * half * x, 0.85 * half * y, seat / 2), frame)
        for x in (-1, 1)
        for y in (-1, 1)
    )
    back = _box((0.015, half, 0.17), (-half, 0, seat + 0.2), rgb)
    return Thing((_box((half, half, 0.02), (0, 0, seat), rgb), back, *legs), half, seat + 0.37)


def _bin(rng: np.random.Generator, rgb: Rgb) -> Thing:
    r, half = rng.uniform(0.08, 0.15), rng.uniform(0.1, 0.18)
    parts = (_post(r, half, (0, 0, half), rgb), _post(0.93 * r, 0.002, (0, 0, 2 * half), DARK))
    return Thing(parts, r, 2 * half)


def _cupboard(rng: np.random.Generator, rgb: Rgb) -> Thing:
    x, y, z = rng.uniform(0.15, 0.3), rng.uniform(0.25, 0.8), rng.uniform(0.2, 0.9)
    joint = (rgb[0] * 0.6, rgb[1] * 0.6, rgb[2] * 0.6)
    parts = [_box((x, y, z), (0, 0, z), rgb, int(rng.choice([0, 0, 3])))]
    for number in range(int(rng.integers(0, 4))):
        height = 2 * z * (number + 1) / 4
        parts.append(_box((1.003 * x, 0.96 * y, 0.008), (0, 0, height), joint))
    return Thing(tuple(parts), y, 2 * z)


def _sofa(rng: np.random.Generator, rgb: Rgb) -> Thing:
    y, seat = rng.uniform(0.4, 0.9), rng.uniform(0.2, 0.25)
    arm = (0.4, 0.09, 0.3)
    return Thing(
        (
            _box((0.4, y, seat / 2 + 0.05), (0, 0, seat / 2 + 0.1), rgb, 4),
            _box((0.1, y, 0.2), (-0.35, 0, seat + 0.3), rgb, 4),
            _box(arm, (0, y + 0.09, 0.35), rgb, 4),
            _box(arm, (0, -y - 0.09, 0.35), rgb, 4),
        ),
        y,
        0.8,
    )


SMALL: dict[str, Make] = {
    "ball": _ball, "can": _can, "bottle": _bottle, "cup": _cup, "shoe": _shoe, "book": _book,
    "cap": _cap, "car": _car, "bag": _bag, "cushion": _cushion, "pot": _pot, "carton": _carton,
    "block": _block, "bin": _bin,
}  # fmt: skip
"""What may stand anywhere."""

LARGE: dict[str, Make] = {
    "chair": _chair, "cupboard": _cupboard, "sofa": _sofa, "pot": _pot, "carton": _carton,
    "cushion": _cushion, "bin": _bin, "bag": _bag, "shoe": _shoe,
}  # fmt: skip
"""What stands along walls."""
