import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.sim.scene.target_object import RED_CUBE, Footprint
from mbot_workstation.tasks.fetch.rules import (
    COMPLETE_SCORE,
    FetchRules,
    at_border,
    draw_kind,
    spawn,
    touch_score,
    touches,
    way_to_contact_m,
)

RULES = FetchRules()
SQUARE = RED_CUBE.footprint
ROUND = Footprint(0, 0, 0.05)
angle = st.floats(-math.pi, math.pi)
place = st.floats(-2.9, 2.9)


def test_the_paper_limits_follow() -> None:
    assert RULES.time_limit_s == pytest.approx(66.8)
    assert 10 * touch_score(0, RULES) + COMPLETE_SCORE == 21
    twenty_decisions = 10 * touch_score(20 * 0.4, RULES) + COMPLETE_SCORE
    assert twenty_decisions == pytest.approx(19.8, abs=0.01)
    assert touch_score(100, RULES) == 1


def test_touch_is_the_circle_meeting_the_square() -> None:
    cube = Pose(1, 0, 0)
    assert touches(Pose(1 - 0.05 - 0.0899, 0), cube, SQUARE, RULES)
    assert not touches(Pose(1 - 0.05 - 0.0901, 0), cube, SQUARE, RULES)
    # A corner: 50 mm x 50 mm and the circle along the diagonal.
    beyond = 0.05 + 0.09 / math.sqrt(2)
    assert touches(Pose(1 - beyond + 1e-4, beyond - 1e-4), cube, SQUARE, RULES)
    assert not touches(Pose(1 - beyond - 1e-4, beyond + 1e-4), cube, SQUARE, RULES)
    # Turned by 45 degrees the corner comes nearer along x.
    turned = replace(cube, yaw_rad=math.pi / 4)
    assert touches(Pose(1 - 0.05 * math.sqrt(2) - 0.0899, 0), turned, SQUARE, RULES)
    assert touches(cube, cube, SQUARE, RULES)


@given(angle, angle)
def test_a_ball_is_touched_alike_from_all_sides(bearing: float, yaw: float) -> None:
    def at(distance: float) -> bool:
        robot = Pose(distance * math.cos(bearing), distance * math.sin(bearing))
        return touches(robot, Pose(0, 0, yaw), ROUND, RULES)

    assert at(0.1399)
    assert not at(0.1401)


@given(angle, st.floats(0.05, 0.5), angle, st.sampled_from([SQUARE, ROUND]))
def test_nothing_is_touched_before_the_way_to_it_is_driven(
    bearing: float, distance: float, yaw: float, footprint: Footprint
) -> None:
    robot = Pose(distance * math.cos(bearing), distance * math.sin(bearing))
    target = Pose(0, 0, yaw)
    if touches(robot, target, footprint, RULES):
        assert way_to_contact_m(robot, target, footprint, RULES) <= 1e-9


def test_kinds_of_object_are_equally_likely_and_a_single_one_costs_no_random_number() -> None:
    rng = np.random.default_rng(0)
    state = rng.bit_generator.state
    assert draw_kind(RULES, rng) == 0
    assert rng.bit_generator.state == state
    both = replace(RULES, footprints=(SQUARE, ROUND))
    assert np.mean([draw_kind(both, rng) for _ in range(2000)]) == pytest.approx(0.5, abs=0.04)


@given(angle, st.floats(0.05, 0.3), angle, angle)
def test_touch_does_not_depend_on_where_north_is(
    bearing: float, distance: float, yaw: float, turn: float
) -> None:
    def at(rotation: float) -> bool:
        robot = Pose(
            distance * math.cos(bearing + rotation), distance * math.sin(bearing + rotation)
        )
        return touches(robot, Pose(0, 0, yaw + rotation), SQUARE, RULES)

    assert at(0.0) == at(turn) or at(1e-9) != at(0.0)


@given(place, place, st.integers(0, 2**32), st.floats(0.45, 2.5))
def test_objects_appear_in_range_and_clear_of_the_robot(
    x: float, y: float, seed: int, radius: float
) -> None:
    rules = FetchRules(spawn_farthest_m=radius)
    cube = spawn(Pose(x, y), rules, np.random.default_rng(seed))
    assert 0.3 <= math.hypot(cube.x_m, cube.y_m) <= radius
    assert math.hypot(cube.x_m - x, cube.y_m - y) >= 0.4


def test_distances_are_uniform() -> None:
    rng = np.random.default_rng(0)
    rules = FetchRules(spawn_farthest_m=2.5)
    far_away = Pose(-2.9, -2.9)
    places = [spawn(far_away, rules, rng) for _ in range(4000)]
    distances = np.array([math.hypot(p.x_m, p.y_m) for p in places])
    assert distances.mean() == pytest.approx(1.4, abs=0.04)
    assert np.mean([p.y_m > 0 for p in places]) == pytest.approx(0.5, abs=0.04)


def test_border() -> None:
    assert not at_border(Pose(2.89, -2.89), RULES)
    assert at_border(Pose(0, -2.9), RULES)
    assert at_border(Pose(2.95, 0), RULES)


@pytest.mark.parametrize("radius", [0.4, 2.9, float("nan")])
def test_ranges_without_a_place_are_refused(radius: float) -> None:
    with pytest.raises(ValueError, match="expected"):
        FetchRules(spawn_farthest_m=radius)


def test_same_seed_same_places() -> None:
    one, other = (spawn(ORIGIN, RULES, np.random.default_rng(5)) for _ in range(2))
    assert one == other


def test_an_object_finds_a_place_where_things_leave_none() -> None:
    first = replace(
        RULES,
        spawn_farthest_m=0.5,
        spawn_half_angle_rad=math.radians(20),
        objects=1,
        standing=(Standing("bag", 0.7, 0.0, 0.2, 0.3),),
    )
    place = spawn(ORIGIN, first, np.random.default_rng(0))
    assert 0.4 <= math.hypot(place.x_m, place.y_m) <= 0.5
