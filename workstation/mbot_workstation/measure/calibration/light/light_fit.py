"""From a gray card's colour under several angles to exposure, white balance and light.

The simulation shades a matte surface by ambient + (1 - ambient) max(0, n·l), in the levels of the
picture, not in physical light: so the fit is made in levels too, and the simulated card then has
the levels of the real one. With b = gain · ambient and d = gain (1 - ambient) l the level is linear
in four numbers, level = card · (b + n·d), wherever the card faces the light.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.scene.scene_parameters import Light

Values = NDArray[np.float64]

FEWEST_FACINGS = 4
"""As many unknowns: brightness from all sides, and three of the light."""

WORST_CONDITION = 100.0
"""Of the 4 unknowns. A card turned by 35 degrees to all sides has 30; beyond 100 one direction was
not tried at all."""

WORST_DIRECTION_DEG = 30.0
"""Half a 95 % cone within which the light must be known to be worth using."""

MOST_ROUNDS = 10
"""Which cards face the light is settled after two or three."""

GUESSES = 400
"""Directions of light, evenly over the sphere, that are tried as beginnings: 11 degrees apart."""

SAME_DIRECTION_DEG = 8.0
SAME_AMBIENT = 0.02
"""Lights nearer to each other than this are one: what recovered lights may be off by."""

GRAZING = 0.02
"""Of the light's full strength on a card: about 1 degree from edge on, less than any facing is
known to."""

EXACT = 0.002
"""Of a reading: a better fit than this can't be told from a perfect one; half a level of 255."""

TOO_FEW_LIT = (
    "too few cards face the light: turn more of them towards window or lamp, or let the robot look "
    "the other way (--heading 180)"
)

LEAST_ERROR = 0.01
"""Of a reading: what paper, hands and noise leave, even where the fit is better by chance."""


@dataclass(frozen=True, slots=True)
class LightFit:
    """The light.

    Attributes:
        exposure_gain: brightness against the simulation's.
        red_gain, blue_gain: against green.
        light: direction and ambient share; as it was given where the photographs can't tell.
        direction_deg: half of the 95 % cone around the direction; None if it was not fitted.
        undetermined: why direction and ambient share were not fitted; None if they were.

    """

    exposure_gain: float
    red_gain: float
    blue_gain: float
    light: Light
    direction_deg: float | None
    undetermined: str | None


def fit_light(
    rgb: Values, normals: Sequence[Values | None], level: float, nominal: Light
) -> LightFit:
    """Fit exposure, white balance and, if the photographs can tell it, the light.

    Args:
        rgb: mean levels of the card in each photograph, shape (n, 3).
        normals: unit vectors out of the card in the arena's axes, shape (3,) each; None where it is
            not known how the card was turned.
        level: sRGB level of the card under full light, such as 118.
        nominal: the light to keep where it can't be told.

    """
    green = rgb[:, 1] / level
    red_gain, blue_gain = (float(rgb[:, c] @ rgb[:, 1] / (rgb[:, 1] @ rgb[:, 1])) for c in (0, 2))
    known = [index for index, normal in enumerate(normals) if normal is not None]
    facings = np.array([normals[index] for index in known]).reshape(-1, 3)
    why = _why_not(facings, len(normals))
    found = None if why else _solve(facings, green[known])
    if isinstance(found, str):
        why = found
    if why or not isinstance(found, _Solution):
        shades = [shade(normal, nominal) for normal in normals]
        gain = float(green @ shades / np.dot(shades, shades))
        return LightFit(gain, red_gain, blue_gain, nominal, None, why)
    gain = found.ambient + float(np.linalg.norm(found.direct))
    x, y, z = (float(-value) for value in found.direct / np.linalg.norm(found.direct))
    light = Light(direction=(x, y, z), ambient=found.ambient / gain)
    return LightFit(gain, red_gain, blue_gain, light, found.cone_deg, None)


def shade(normal: Values | None, light: Light) -> float:
    """The share of its own brightness the simulation gives a matte surface, in [0, 1].

    `normal` is its unit vector outwards, shape (3,). A card whose facing is not known is taken to
    face the robot at its start, along -x.
    """
    facing = np.array([-1.0, 0, 0]) if normal is None else normal
    towards = -np.array(light.direction) / np.linalg.norm(light.direction)
    return light.ambient + (1 - light.ambient) * max(0.0, float(facing @ towards))


@dataclass(frozen=True, slots=True)
class _Solution:
    ambient: float
    direct: Values
    cone_deg: float


def _why_not(facings: Values, photographs: int) -> str | None:
    """Why these facings can't tell the light; None if they can."""
    if len(facings) < FEWEST_FACINGS:
        return (
            f"it is known of {len(facings)} of {photographs} photographs how the card is turned, "
            f"expected at least {FEWEST_FACINGS}: use the frame of `workstation print gray-card`, "
            "or --facing"
        )
    apart = np.degrees(np.arccos(np.clip((facings @ facings.T).min(), -1, 1)))
    if apart < 25:
        return (
            f"all cards face one way, within {apart:.0f} degrees: turn the card left, right and up"
        )
    if np.linalg.cond(_design(facings, np.ones(len(facings), bool))) > WORST_CONDITION:
        return "the card was turned about one axis only: tilt it up and to a side as well"
    return None


def _design(facings: Values, lit: NDArray[np.bool_]) -> Values:
    return np.column_stack([np.ones(len(facings)), facings * lit[:, None]])


def _solve(facings: Values, levels: Values) -> _Solution | str:
    """Least squares, with the cards that face away from the light lit from all sides only.

    Which cards those are depends on the light. From a wrong guess the fit may settle on a light
    that agrees with itself and is wrong, so all guesses are tried. The best one that enough cards
    face counts, unless something else explains the readings clearly better, or as well.
    """
    found = [fit for lit in _guesses(facings) if (fit := _settle(facings, levels, lit)) is not None]
    told = [fit for fit in found if fit.condition <= WORST_CONDITION]
    if not told:
        return TOO_FEW_LIT
    best = min(told, key=lambda fit: fit.error)
    alike = max(2 * min(fit.error for fit in found), EXACT * float(levels.mean()))
    if best.error > alike:
        return TOO_FEW_LIT
    if any(fit.error <= alike and _differ(fit.solution, best.solution) for fit in told):
        return (
            "two different lights explain the photographs alike: turn the card to more sides, so "
            "that more of them face the light"
        )
    return _judged(best, levels)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A light that agrees with which cards it was taken to light.

    Attributes:
        design: shape (n, 4).
        solution: brightness from all sides and the light's vector, shape (4,).
        error: standard deviation of a reading.
        condition: of the unknowns, by the cards that the light clearly reaches.

    """

    design: Values
    solution: Values
    error: float
    condition: float


def _guesses(facings: Values) -> list[NDArray[np.bool_]]:
    """All ways in which lights from everywhere light the cards, but for very rare ones."""
    number = np.arange(GUESSES) + 0.5
    height, turn = 1 - 2 * number / GUESSES, math.pi * (1 + math.sqrt(5)) * number
    across = np.sqrt(1 - height**2)
    lights = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    patterns = np.unique(facings @ lights.T > 0, axis=1).T
    return [np.ones(len(facings), bool), *patterns]


def _settle(facings: Values, levels: Values, lit: NDArray[np.bool_]) -> _Fit | None:
    """Fit, see which cards the result lights, and again; None if that never settles."""
    for _ in range(MOST_ROUNDS):
        design = _design(facings, lit)
        solution = np.asarray(np.linalg.lstsq(design, levels, rcond=None)[0], np.float64)
        direct = facings @ solution[1:]
        if ((direct > 0) == lit).all():
            spare = max(1, len(levels) - 4)
            error = float(np.sqrt(((design @ solution - levels) ** 2).sum() / spare))
            # A card that the light only grazes may as well face away from it: it fixes nothing.
            clearly = direct > GRAZING * float(np.linalg.norm(solution[1:]))
            condition = float(np.linalg.cond(_design(facings, clearly)))
            return _Fit(design, solution, error, condition)
        lit = direct > 0
    return None


def _differ(one: Values, other: Values) -> bool:
    """Whether two solutions are lights that would look different."""
    cosine = one[1:] @ other[1:] / (np.linalg.norm(one[1:]) * np.linalg.norm(other[1:]))
    ambients = [fit[0] / (fit[0] + np.linalg.norm(fit[1:])) for fit in (one, other)]
    return bool(
        cosine < math.cos(math.radians(SAME_DIRECTION_DEG))
        or abs(ambients[0] - ambients[1]) > SAME_AMBIENT
    )


def _judged(fit: _Fit, levels: Values) -> _Solution | str:
    """The solution, unless it is too uncertain or can't be."""
    ambient, direct = float(fit.solution[0]), np.asarray(fit.solution[1:], np.float64)
    strength = float(np.linalg.norm(direct))
    error = max(fit.error, LEAST_ERROR * float(levels.mean()))
    covariance = error**2 * np.linalg.inv(fit.design.T @ fit.design)[1:, 1:]
    across = np.eye(3) - np.outer(direct, direct) / strength**2
    widest = float(np.linalg.eigvalsh(across @ covariance @ across)[-1])
    cone_deg = float(np.degrees(np.arctan2(2 * np.sqrt(widest), strength)))
    if cone_deg > WORST_DIRECTION_DEG:
        return (
            f"the card looks nearly alike from all sides (direction known to +-{cone_deg:.0f} "
            "degrees): there is no main light, or the photographs are too alike"
        )
    if ambient < 0:
        return (
            "the card gets darker than any light from one side explains: was its shadow, or a "
            "hand's, on it, or did the exposure change between photographs?"
        )
    if direct[2] <= 0.02 * strength:
        return "the light would come from below the floor: are the facings right?"
    return _Solution(ambient, direct, cone_deg)
