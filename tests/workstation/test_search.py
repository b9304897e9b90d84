import math
from itertools import pairwise

import pytest

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.search import (
    AROUND_M,
    MIDDLE,
    PLACES,
    THERE_M,
    WHOLE_TURN_RAD,
    Search,
)

Taken = tuple[tuple[float, float, float], ...]


def turn(search: Search, at: Pose, taken: Taken = ()) -> Pose | None:
    """A whole turn on the spot and a bit more, half a radian at a time."""
    for step in range(math.ceil(WHOLE_TURN_RAD / 0.5) + 2):
        search.advance(Pose(at.x_m, at.y_m, -0.5 * step), taken)
    return search.goes_to


def look_around(search: Search, start: Pose, stops: int, taken: Taken = ()) -> list[Pose]:
    """Turn in vain and drive where it says, so many times."""
    robot, been = start, list[Pose]()
    for _ in range(stops):
        place = turn(search, robot, taken)
        assert place is not None
        been.append(place)
        robot = place
        search.advance(robot, taken)
        assert search.goes_to is None, "there it turns first"
    return been


def places(poses: list[Pose]) -> list[tuple[float, float]]:
    return [(pose.x_m, pose.y_m) for pose in poses]


def test_only_a_whole_turn_in_vain_leads_elsewhere() -> None:
    search = Search()
    for step in range(int(WHOLE_TURN_RAD / 0.5)):
        search.advance(Pose(1.0, 0.2, 0.5 * step))
        assert search.goes_to is None
    assert turn(search, Pose(1.0, 0.2)) == Pose(AROUND_M, 0.0), "the nearest place"


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


def test_it_looks_from_everywhere_once_before_it_comes_back() -> None:
    search = Search()
    been = places(look_around(search, ORIGIN, len(PLACES) + 3))
    first = been[: len(PLACES) - 1]
    assert {MIDDLE, *first} == set(PLACES), "it stands in the middle, which it has seen"
    assert len(set(first)) == len(first)
    assert set(been[len(PLACES) - 1 :]) <= set(PLACES)
    hops = [math.dist(one, other) for one, other in pairwise(first)]
    assert max(hops) == pytest.approx(2 * AROUND_M * math.sin(math.pi / 8)), "always the nearest"


def test_what_stands_on_a_place_is_not_driven_to() -> None:
    search = Search()
    taken = ((AROUND_M, 0.1, 0.3), (0.0, AROUND_M, 0.3))
    been = places(look_around(search, ORIGIN, 20, taken))
    assert len(set(been)) == len(PLACES) - 2
    assert all(math.dist(place, one[:2]) > 0.3 for place in been for one in taken)


def test_where_everything_is_taken_it_turns_on() -> None:
    assert turn(Search(), Pose(1.0, 0.0), ((0.0, 0.0, 9.0),)) is None


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
        search.advance(Pose(0.5, 0.0, 0.5 * step))
        assert search.goes_to == place
    search.advance(Pose(place.x_m, place.y_m, 0.0))
    search.advance(Pose(place.x_m, place.y_m, 1.0))
    assert search.goes_to is None
