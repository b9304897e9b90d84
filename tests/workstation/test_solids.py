"""What can't be driven through, against places sampled along every line."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.tasks.floor.solids import WALL_M, Solids, Wall

metres = st.floats(-2.0, 2.0)
walls = st.lists(st.builds(Wall, metres, metres, metres, metres), min_size=1, max_size=4)
things = st.lists(
    st.builds(Standing, st.just("bin"), metres, metres, st.floats(0.02, 0.3), st.just(0.3)),
    max_size=3,
)
SHARES = np.linspace(0, 1, 401)
APART_M = math.hypot(4, 4) / 400
"""Between two samples, at most."""


def samples(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    return start + SHARES[:, None] * (end - start)


@given(things, walls, metres, metres)
def test_a_gap_is_the_way_to_the_nearest_place_of_each(
    stand: list[Standing], built: list[Wall], x_m: float, y_m: float
) -> None:
    solids = Solids.of(stand, built)
    gaps_m = solids.gaps_m(np.array([x_m, y_m]))
    assert gaps_m.shape == (len(stand) + len(built),)
    for number, gap_m in enumerate(gaps_m.tolist()):
        line = samples(solids.starts[number], solids.ends[number])
        sampled_m = np.hypot(*(line - (x_m, y_m)).T).min() - solids.radii_m[number]
        assert sampled_m - APART_M <= gap_m <= sampled_m + 1e-9
    assert solids.radii_m[-1] == WALL_M / 2


@given(walls, metres, metres, metres, metres)
def test_a_way_is_as_near_to_a_wall_as_its_nearest_place(
    built: list[Wall], x0: float, y0: float, x1: float, y1: float
) -> None:
    solids = Solids.of((), built)
    (beside_m,) = solids.beside_m(Pose(x0, y0), np.array([[x1, y1]]))
    way = samples(np.array([x0, y0]), np.array([x1, y1]))
    for number, near_m in enumerate(beside_m.tolist()):
        line = samples(solids.starts[number], solids.ends[number])
        sampled_m = np.hypot(*(way[:, None] - line[None]).transpose(2, 0, 1)).min()
        assert sampled_m - APART_M <= near_m <= sampled_m + 1e-9


def test_many_ways_at_once_are_as_each_by_itself() -> None:
    solids = Solids.of((Standing("bin", 1.0, 0.0, 0.1, 0.3),), (Wall(-1, -1, -1, 1),))
    ends = np.array([[2.0, 0.0], [0.0, 2.0], [-2.0, 0.0]])
    alone = [solids.beside_m(Pose(0.0, 0.0), end[None])[0] for end in ends]
    np.testing.assert_array_equal(solids.beside_m(Pose(0.0, 0.0), ends), alone)
    np.testing.assert_allclose(alone, [[0, 1], [1, 1], [1, 0]], atol=1e-12)


def test_who_overlaps_is_moved_straight_out() -> None:
    solids = Solids.of((Standing("bin", 1.0, 0.0, 0.2, 0.3),), (Wall(0, -1, 3, -1),))
    assert solids.out_of_m(Pose(0.75, 0.0), 0.1, 1e-4) == pytest.approx((-0.05, 0.0))
    assert solids.out_of_m(Pose(2.0, -0.9), 0.1, 1e-4) == pytest.approx((0.0, WALL_M / 2))
    assert solids.out_of_m(Pose(0.70005, 0.0), 0.1, 1e-4) == (0.0, 0.0), "hardly"
    assert solids.out_of_m(Pose(-1.0, 1.0), 0.1, 1e-4) == (0.0, 0.0)
    assert Solids.of(()).out_of_m(Pose(0.0, 0.0), 0.1, 1e-4) == (0.0, 0.0)


def test_a_wall_is_drawn_where_it_stands() -> None:
    piece = Wall(1.0, 0.0, 1.0, 2.0).piece(0.5, (0.5, 0.5, 0.5))
    assert piece.centre_m == (1.0, 1.0, 0.25)
    assert piece.half_size_m == pytest.approx((1.0 + WALL_M / 2, WALL_M / 2, 0.25))
    assert piece.yaw_rad == pytest.approx(math.pi / 2)
