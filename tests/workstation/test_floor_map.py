import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.tasks.floor.floor_map import CELL_M, ROOM_M, FloorMap, Ways
from mbot_workstation.tasks.floor.solids import Solids

ROBOT_M = 0.09
Things = tuple[Standing, ...]


def post(x_m: float, y_m: float, radius_m: float = 0.06) -> Standing:
    return Standing("post", x_m, y_m, radius_m, 0.3)


WALL = tuple(post(1.0, y) for y in np.arange(-1.0, 1.05, 0.1).tolist())
RING = tuple(
    post(1.5 + 0.4 * math.cos(a), 0.4 * math.sin(a)) for a in np.arange(0, 6.3, 0.2).tolist()
)


def floor_of(things: Things) -> FloorMap:
    return FloorMap(2.5, Solids.of(things), ROBOT_M)


def gap_m(floor: FloorMap, robot: Pose) -> float:
    """How far it is to the nearest thing, less than 0 while the robot touches it."""
    gaps_m = floor.solids.gaps_m(np.array([robot.x_m, robot.y_m]))
    return float(gaps_m.min(initial=math.inf)) - ROBOT_M


def walk(ways: Ways, start: Pose) -> tuple[float, float]:
    """Drive where it says, 2 cm at a time: how far that is, and how near it comes to a thing."""
    goal, robot, way_m, room_m = ways.goal, start, 0.0, math.inf
    for _ in range(600):
        if math.hypot(goal.x_m - robot.x_m, goal.y_m - robot.y_m) < 0.03:
            return way_m, room_m
        aim = ways.next_from(robot)
        away_m = math.hypot(aim.x_m - robot.x_m, aim.y_m - robot.y_m)
        step = min(0.02, away_m) / max(away_m, 1e-9)
        robot = Pose(
            robot.x_m + step * (aim.x_m - robot.x_m), robot.y_m + step * (aim.y_m - robot.y_m)
        )
        way_m += min(0.02, away_m)
        room_m = min(room_m, gap_m(ways.floor, robot))
    raise AssertionError(f"never gets there: {robot}")


def test_on_an_empty_floor_the_way_is_the_goal() -> None:
    goal = Pose(1.3, -0.7, 0.4)
    ways = floor_of(()).ways_to(goal)
    assert ways.next_from(ORIGIN) == goal
    way_m, _ = walk(ways, ORIGIN)
    assert way_m == pytest.approx(math.hypot(1.3, 0.7), abs=0.04)


def test_every_cell_is_as_far_as_eight_neighbours_make_it() -> None:
    goal = Pose(0.05, 0.05)
    far_m = floor_of(()).ways_to(goal).far_m
    assert far_m.shape == (50, 50)
    x, y = floor_of(()).cell(goal)
    dx, dy = np.abs(np.arange(50) - x)[:, None], np.abs(np.arange(50) - y)[None]
    octile = CELL_M * (np.maximum(dx, dy) + (math.sqrt(2) - 1) * np.minimum(dx, dy))
    np.testing.assert_allclose(far_m, octile)


def test_the_way_goes_around_a_wall_and_never_through() -> None:
    ways = floor_of(WALL).ways_to(Pose(2.0, 0.2))
    way_m, room_m = walk(ways, ORIGIN)
    assert room_m > 0
    around_m = math.hypot(1.0, 1.15) + math.hypot(1.0, 0.95)
    assert around_m < way_m < 1.15 * around_m, "by its nearer end, without going far about"


def test_a_goal_that_cannot_be_reached_is_where_it_says_to_drive() -> None:
    goal = Pose(1.5, 0.0)
    ways = floor_of(RING).ways_to(goal)
    assert math.isinf(ways.far_m[floor_of(RING).cell(ORIGIN)])
    assert ways.next_from(ORIGIN) == goal
    assert not floor_of(RING).is_clear(ORIGIN, np.array([[1.5, 0.0]]))[0]


def test_who_is_within_the_ring_gets_there() -> None:
    ways = floor_of(RING).ways_to(Pose(1.6, 0.0))
    assert walk(ways, Pose(1.4, 0.0))[0] == pytest.approx(0.2, abs=0.04)


things_about = st.lists(
    st.builds(post, st.floats(-1.8, 1.8), st.floats(-1.8, 1.8), st.floats(0.03, 0.25)),
    min_size=1,
    max_size=8,
)
inside = st.builds(Pose, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))


@settings(max_examples=60)
@given(things_about, inside, inside)
def test_among_things_the_next_place_is_reached_in_a_clear_straight_line(
    things: list[Standing], start: Pose, goal: Pose
) -> None:
    floor = floor_of(tuple(things))
    for end in (start, goal):
        assume(gap_m(floor, end) > ROOM_M)
    ways = floor.ways_to(goal)
    aim = ways.next_from(start)
    if math.isinf(ways.far_m[floor.cell(start)]):
        return
    for share in np.linspace(0, 1, 100).tolist():
        between = Pose(
            start.x_m + share * (aim.x_m - start.x_m), start.y_m + share * (aim.y_m - start.y_m)
        )
        room_m = gap_m(floor, between)
        assert room_m > 0.6 * ROOM_M


def test_who_touches_a_thing_may_drive_away_and_not_on() -> None:
    floor = floor_of((post(0.14, 0.0),))
    ends = np.array([[-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [1.0, 0.6]])
    assert floor.is_clear(ORIGIN, ends).tolist() == [True, True, True, False, False]


def test_a_robot_beside_a_thing_finds_out_of_the_cells_that_the_thing_takes() -> None:
    floor = floor_of((post(0.14, 0.0, 0.05), post(0.14, 0.2, 0.05), post(0.14, -0.2, 0.05)))
    ways = floor.ways_to(Pose(1.0, 0.0))
    assert walk(ways, ORIGIN)[1] > -0.01


def test_what_is_outside_belongs_to_the_nearest_cell() -> None:
    floor = floor_of(())
    assert floor.cell(Pose(-9.0, 9.0)) == (0, 49)
    assert floor.cell(Pose(-2.45, 2.45)) == (0, 49)
    assert floor.cell(Pose(0.01, -0.01)) == (25, 24)
    assert floor.ways_to(Pose(1.0, 0.0)).next_from(Pose(-2.6, 0.0)) == Pose(1.0, 0.0)
