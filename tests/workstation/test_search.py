import math

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.floor.floor_map import FloorMap
from mbot_workstation.tasks.floor.search import (
    MIDDLE,
    PLACES,
    RINGS_M,
    SEEN_M,
    THERE_M,
    WHOLE_TURN_RAD,
    Search,
)
from mbot_workstation.tasks.floor.solids import Solids, Wall

ACROSS = FloorMap(2.75, Solids.of((), (Wall(0.6, -3.0, 0.6, 1.6), Wall(0.6, 2.4, 0.6, 3.0))), 0.09)
"""A wall with a door up on the left side."""


def turn(search: Search, at: Pose, floor: FloorMap | None = None) -> Pose | None:
    """A whole turn on the spot and a bit more, half a radian at a time."""
    for step in range(math.ceil(WHOLE_TURN_RAD / 0.5) + 2):
        search.advance(Pose(at.x_m, at.y_m, -0.5 * step), floor)
    return search.goes_to


def look_around(search: Search, start: Pose, stops: int, floor: FloorMap) -> list[Pose]:
    """Turn in vain and drive where it says, so many times."""
    robot, been = start, list[Pose]()
    for _ in range(stops):
        place = turn(search, robot, floor)
        assert place is not None
        been.append(place)
        robot = place
        search.advance(robot, floor)
        assert search.goes_to is None, "there it turns first"
    return been


def test_only_a_whole_turn_in_vain_leads_elsewhere() -> None:
    search = Search()
    for step in range(int(WHOLE_TURN_RAD / 0.5)):
        search.advance(Pose(1.0, 0.2, 0.5 * step))
        assert search.goes_to is None
    assert turn(search, Pose(1.0, 0.2)) is not None


def test_turns_count_on_either_side_and_over_the_back() -> None:
    search = Search()
    yaw = 3.0
    for step in range(60):
        yaw += 0.3 if step % 2 else -0.3
        search.advance(Pose(1.0, 0.2, math.remainder(yaw, 2 * math.pi)))
    assert search.goes_to is not None


def test_what_comes_into_view_ends_it() -> None:
    search = Search()
    assert turn(search, ORIGIN) is not None
    search.begin()
    assert search.goes_to is None
    search.advance(Pose(0.0, 0.0, 1.0))
    assert search.goes_to is None


def test_to_be_carried_while_nothing_is_looked_for_is_no_turn() -> None:
    search = Search()
    search.advance(Pose(0.0, 0.0, 3.0))
    search.begin()
    for step in range(int(WHOLE_TURN_RAD / 0.5)):
        search.advance(Pose(0.0, 0.0, 0.5 * step))
        assert search.goes_to is None


def test_it_looks_behind_a_wall_before_it_looks_again_where_it_has_looked() -> None:
    been = look_around(Search(), Pose(-0.5, 0.0), 2, ACROSS)
    assert all(place.x_m > 0.6 for place in been)
    assert not ACROSS.is_in_sight(Pose(-0.5, 0.0), been[0])


def test_of_what_it_has_not_seen_the_shortest_way_comes_first() -> None:
    (place,) = look_around(Search(), Pose(-0.5, 0.0), 1, ACROSS)
    ways = ACROSS.ways_to(Pose(-0.5, 0.0))
    hidden = [Pose(*one) for one in PLACES if ACROSS.is_free(Pose(*one))]
    hidden = [one for one in hidden if not ACROSS.is_in_sight(Pose(-0.5, 0.0), one)]
    assert ways.from_m(place) == min(ways.from_m(one) for one in hidden)


def test_the_other_side_of_a_wall_is_further_than_it_looks() -> None:
    wall = FloorMap(2.75, Solids.of((), (Wall(-3.0, 0.5, 1.9, 0.5),)), 0.09)
    behind, around = (-0.5, 1.0), (2.3, 1.5)
    robot = Pose(-0.5, 0.0)
    assert math.dist(behind, (-0.5, 0.0)) < math.dist(around, (-0.5, 0.0))
    assert not any(wall.is_in_sight(robot, Pose(*place)) for place in (behind, around))
    assert turn(Search((behind, around)), robot, wall) == Pose(*around)


def test_who_has_seen_everything_begins_again() -> None:
    floor = FloorMap(2.75, Solids.of(()), 0.09)
    first = turn(Search(), ORIGIN, floor)
    assert first is not None
    assert math.hypot(first.x_m, first.y_m) < RINGS_M[0] + 0.01 < SEEN_M
    assert len(look_around(Search(), ORIGIN, 12, floor)) == 12


def test_where_everything_is_taken_it_turns_on() -> None:
    walled = FloorMap(2.75, Solids.of((), [Wall(x / 10, -3, x / 10, 3) for x in range(-30, 31)]), 1)
    assert turn(Search(), Pose(1.0, 0.0), walled) is None


def test_to_the_middle_alone() -> None:
    search = Search((MIDDLE,))
    far = Pose(1.5, 0.0)
    assert turn(search, far) == Pose(*MIDDLE)
    search.advance(Pose(THERE_M + 0.01, 0.0))
    assert search.goes_to is not None, "not there yet"
    search.advance(Pose(THERE_M - 0.01, 0.0))
    assert search.goes_to is None


def test_who_is_near_the_middle_turns_on_where_it_is() -> None:
    search = Search((MIDDLE,))
    assert turn(search, Pose(0.1, 0.1)) is None
    assert turn(search, Pose(0.1, 0.1)) is None
    assert turn(search, Pose(1.0, 0.0)) == Pose(*MIDDLE), "carried away it goes there"


def test_turns_on_the_way_to_a_place_do_not_count_there() -> None:
    search = Search()
    place = turn(search, ORIGIN)
    assert place is not None
    for step in range(40):
        search.advance(Pose(0.5 * place.x_m, 0.5 * place.y_m, 0.5 * step))
        assert search.goes_to == place
    search.advance(Pose(place.x_m, place.y_m, 0.0))
    search.advance(Pose(place.x_m, place.y_m, 1.0))
    assert search.goes_to is None
