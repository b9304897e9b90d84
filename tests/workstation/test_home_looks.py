import colorsys
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.sim.effects import home_looks
from mbot_workstation.sim.effects.home_looks import (
    ALIKE,
    FROM_START_M,
    MOST_PIECES,
    draw_home,
)
from mbot_workstation.sim.effects.scene_looks import MADE_UP_FLOORS, training_floors
from mbot_workstation.sim.scene.finishes import FINISHES
from mbot_workstation.sim.scene.object_mjcf import DISTRACTORS
from mbot_workstation.sim.scene.target_object import RED_CUBE, Rgb, Shape, TargetObject
from mbot_workstation.sim.scene.things import LARGE, SMALL

BALL = TargetObject("green ball", Shape.BALL, colour_srgb=(30, 150, 50))


def is_red(rgb: Rgb) -> bool:
    hue, saturation, value = colorsys.rgb_to_hsv(*rgb)
    return min(hue, 1 - hue) < 0.055 and saturation > 0.5 and value > 0.25


@given(st.integers(0, 2**32))
def test_a_home_is_one_that_can_be_drawn_and_driven_in(seed: int) -> None:
    look = draw_home(np.random.default_rng(seed), (RED_CUBE,))
    assert 0 <= look.floor <= len(training_floors())
    assert 0 <= look.floor_mirrors < 1
    assert len(look.distractors) <= MOST_PIECES <= len(DISTRACTORS) // 2
    (worn,) = look.objects
    red, green, blue = worn.rgb
    assert red > 1.5 * max(green, blue)
    assert worn.wear < FINISHES
    for thing in look.standing:
        from_start_m = math.hypot(thing.x_m, thing.y_m) - thing.radius_m
        assert from_start_m >= FROM_START_M
        assert thing.radius_m < 0.3


def test_whatever_costs_is_seen_also_where_there_is_no_room_for_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(home_looks, "MOST_PIECES", 12)
    for seed in range(200):
        look = draw_home(np.random.default_rng(seed), (RED_CUBE,))
        assert len(look.distractors) <= 12
        places = [piece.centre_m[:2] for piece in look.distractors]
        for thing in look.standing:
            assert min(math.dist(place, (thing.x_m, thing.y_m)) for place in places) < 0.3


def test_homes_show_all_there_is() -> None:
    looks = [draw_home(np.random.default_rng(seed), (RED_CUBE,)) for seed in range(400)]
    names = {thing.name for look in looks for thing in look.standing}
    assert names == set(SMALL)
    assert {look.floor for look in looks} > {0, MADE_UP_FLOORS + 1}
    assert 0.3 < np.mean([look.floor_mirrors > 0 for look in looks]) < 0.6
    assert 0.4 < np.mean([look.wall_height_m == 0 for look in looks]) < 0.7
    assert any(look.objects[0].labelled for look in looks)
    reds = [any(is_red(piece.rgb) for piece in look.distractors) for look in looks]
    assert np.mean(reds) > 0.7, "most homes have something of the object's colour"


@pytest.mark.parametrize("thing", [RED_CUBE, BALL])
def test_nothing_of_its_shape_has_its_colour(thing: TargetObject) -> None:
    hue = thing.mean_hsv[0]
    for seed in range(300):
        look = draw_home(np.random.default_rng(seed), (thing,))
        alike = [one for one in look.standing if one.name in ALIKE[thing.shape]]
        for one in alike:
            (piece,) = (
                piece
                for piece in look.distractors
                if piece.centre_m[:2] == (one.x_m, one.y_m) and piece.opacity == 1
            )
            apart = abs((colorsys.rgb_to_hsv(*piece.rgb)[0] - hue + 0.5) % 1 - 0.5)
            assert apart > 0.03 or not is_red(piece.rgb)


@pytest.mark.parametrize("name", [*SMALL, *LARGE])
def test_things_stand_on_the_floor_within_their_circle(name: str) -> None:
    for seed in range(40):
        thing = {**SMALL, **LARGE}[name](np.random.default_rng(seed), (0.8, 0.1, 0.1))
        assert 0.02 < thing.radius_m < 1.0
        assert 0.01 < thing.height_m < 2.0
        for part in thing.parts:
            x, y, z = part.centre_m
            assert math.hypot(x, y) < 1.6 * thing.radius_m + 0.12
            assert 0 <= z < 1.3 * thing.height_m + 0.2
            assert min(part.half_size_m) > 0


def test_a_thing_keeps_its_shape_where_it_is_put() -> None:
    thing = SMALL["car"](np.random.default_rng(0), (0.1, 0.1, 0.9))
    here, there = thing.at(0, 0, 0), thing.at(1.0, -2.0, math.pi / 2, up_m=0.5)
    for one, other in zip(here, there, strict=True):
        (x, y, z), moved = one.centre_m, other.centre_m
        assert moved == pytest.approx((1.0 - y, -2.0 + x, 0.5 + z))
        assert other.yaw_rad - one.yaw_rad == pytest.approx(math.pi / 2)
