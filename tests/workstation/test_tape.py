import math

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose
from mbot_workstation.tasks.floor.tape import (
    PIECE_M,
    THICK_M,
    WIDTH_M,
    Points,
    Tape,
    even,
    figure_eight,
    laid_from,
    round_line,
)

place = st.floats(-2.0, 2.0)
heading = st.floats(-math.pi, math.pi)
seeds = st.integers(0, 10_000)


@st.composite
def polygons(draw: st.DrawFn) -> Points:
    """Any closed line of 3 to 9 points, which may cross itself."""
    count = draw(st.integers(3, 9))
    points = np.array([(draw(place), draw(place)) for _ in range(count)])
    side_m = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    assume(side_m.min() > 0.05)
    return points


@st.composite
def lines(draw: st.DrawFn, piece_m: float = PIECE_M) -> Points:
    """A line as tasks lay it."""
    rng = np.random.default_rng(draw(seeds))
    if draw(st.booleans()):
        return figure_eight(rng, (0.9, 1.1), piece_m)
    return round_line(rng, (0.7, 1.4), 0.25, piece_m)


def along(points: Points, share: NDArray[np.float64]) -> Points:
    """Places of every side, at these shares of it."""
    side = np.roll(points, -1, axis=0) - points
    return (points[:, None] + share[:, None] * side[:, None]).reshape(-1, 2)


def length_m(points: Points) -> float:
    return float(np.hypot(*(np.roll(points, -1, axis=0) - points).T).sum())


def is_inside(points: Points, x_m: float, y_m: float) -> bool:
    """By how many sides are met straight up."""
    inside = False
    for (ax, ay), (bx, by) in zip(points.tolist(), np.roll(points, -1, 0).tolist(), strict=True):
        if (ax > x_m) != (bx > x_m) and y_m < ay + (x_m - ax) * (by - ay) / (bx - ax):
            inside = not inside
    return inside


def is_level_with_a_corner(points: Points, x_m: float, y_m: float, yaw_rad: float) -> bool:
    """Whether a ray passes through a corner, or nearly: the sides that meet there may disagree."""
    beside = math.cos(yaw_rad) * (points[:, 1] - y_m) - math.sin(yaw_rad) * (points[:, 0] - x_m)
    return bool(np.abs(beside).min() < 1e-6)


@given(polygons(), place, place)
def test_the_nearest_of_a_tape_is_as_near_as_its_nearest_sample(
    points: Points, x_m: float, y_m: float
) -> None:
    samples = along(points, np.linspace(0, 1, 1001))
    sampled_m = float(np.hypot(*(samples - (x_m, y_m)).T).min())
    away_m = Tape(points).away_m(x_m, y_m)
    assert away_m <= sampled_m + 1e-9
    assert away_m >= sampled_m - 0.006 / 2, "sides of at most 5.7 m, in a thousand parts"


@given(polygons(), place, place)
def test_a_place_is_inside_as_often_as_rays_in_other_directions_say(
    points: Points, x_m: float, y_m: float
) -> None:
    assume(Tape(points).away_m(x_m, y_m) > 1e-6)
    assume(not is_level_with_a_corner(points, x_m, y_m, math.pi / 2))
    assert Tape(points).encloses(x_m, y_m) == is_inside(points, x_m, y_m)


@given(seeds, place, place)
def test_inside_a_round_line_is_what_it_winds_around(seed: int, x_m: float, y_m: float) -> None:
    points = round_line(np.random.default_rng(seed), (0.8, 1.4), 0.25)
    assume(Tape(points).away_m(x_m, y_m) > 1e-6)
    angles = np.arctan2(points[:, 1] - y_m, points[:, 0] - x_m)
    turns = np.remainder(np.diff(angles, append=angles[:1]) + math.pi, 2 * math.pi) - math.pi
    assert Tape(points).encloses(x_m, y_m) == (abs(round(turns.sum() / (2 * math.pi))) == 1)


@given(polygons(), place, place, heading)
def test_the_way_ends_on_the_tape_and_meets_none_before(
    points: Points, x_m: float, y_m: float, yaw_rad: float
) -> None:
    tape = Tape(points)
    assume(tape.away_m(x_m, y_m) > 1e-3)
    assume(not is_level_with_a_corner(points, x_m, y_m, yaw_rad))
    way_m = tape.way_m(Pose(x_m, y_m, yaw_rad))
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    inside = is_inside(points, x_m, y_m)
    if math.isinf(way_m):
        assert not inside, "there is no way out"
        way_m = 6.0
    else:
        assert tape.away_m(x_m + way_m * cos, y_m + way_m * sin) < 1e-6
    for share in np.linspace(0.0, 1 - 1e-6, 40).tolist():
        x, y = x_m + share * way_m * cos, y_m + share * way_m * sin
        if tape.away_m(x, y) > 1e-4:
            assert is_inside(points, x, y) == inside, f"crossed at {share} of the way"


def test_the_way_of_a_square_is_what_anybody_would_say() -> None:
    square = Tape(np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]))
    assert square.way_m(Pose(0.25, 0.0, 0.0)) == 0.75
    assert math.isclose(square.way_m(Pose(0.0, 0.0, math.pi / 4)), math.sqrt(2))
    assert math.isinf(square.way_m(Pose(2.0, 0.0, 0.0)))
    assert (square.away_m(2.0, 2.0), square.away_m(0.0, 0.5)) == (math.sqrt(2), 0.5)


@given(lines(0.01), st.floats(0.02, PIECE_M))
def test_points_that_are_laid_evenly_are_on_the_line_and_equally_far_apart(
    fine: Points, piece_m: float
) -> None:
    laid = even(fine, piece_m)
    assert abs(length_m(laid) / length_m(fine) - 1) < 0.01
    side_m = np.hypot(*(np.roll(laid, -1, axis=0) - laid).T)
    assert side_m.max() <= piece_m + 1e-9
    assert np.ptp(side_m) < 0.04 * side_m.mean(), "a bend's pieces are chords"
    tape = Tape(fine)
    assert max(tape.away_m(x, y) for x, y in laid.tolist()) < 1e-9
    assert laid[0].tolist() == fine[0].tolist()


def test_what_is_shorter_than_a_piece_is_a_triangle() -> None:
    tiny = np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.01], [0.0, 0.01]])
    assert len(even(tiny, PIECE_M)) == 3


@given(lines(), st.integers(0, 200))
def test_a_line_is_laid_from_the_origin_along_x_and_keeps_its_shape(
    points: Points, first: int
) -> None:
    first %= len(points)
    laid = laid_from(points, first)
    np.testing.assert_allclose(laid[0], 0.0, atol=1e-12)
    ahead, left = laid[1] - laid[-1]
    assert ahead > 0
    assert abs(left) < 1e-12
    moved = np.roll(points, -first, axis=0)

    def between(some: Points) -> Points:
        return np.hypot(*(some[:, None] - some[None]).transpose(2, 0, 1))

    def turned(some: Points) -> float:
        x, y = some.T
        return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())

    np.testing.assert_allclose(between(laid), between(moved), atol=1e-9)
    assert math.isclose(turned(laid), turned(moved), abs_tol=1e-9), "it is not mirrored"


@given(seeds)
def test_a_round_line_is_about_the_origin_and_nearly_as_wide_as_told(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plain = np.hypot(*round_line(rng, (0.8, 1.4), 0.0).T)
    assert 0.79 < plain.min() <= plain.max() < 1.4 + 1e-9
    assert np.ptp(plain) < 0.005
    dented = round_line(rng, (1.0, 1.0), 0.2)
    assert Tape(dented).encloses(0.001, 0.0007)
    away_m = np.hypot(*dented.T)
    assert 0.69 < away_m.min() < away_m.max() < 1.3 + 1e-9


@given(seeds)
def test_a_figure_of_eight_passes_its_middle_twice(seed: int) -> None:
    points = figure_eight(np.random.default_rng(seed), (0.9, 1.1), 0.02)
    near = np.flatnonzero(np.hypot(*points.T) < 0.05)
    passes = np.flatnonzero(np.diff(near) > len(points) / 4)
    assert len(passes) == 1 + (near[0] == 0), "a fresh start of a pass is a pass cut in two"
    assert 0.89 < np.abs(points[:, 0]).max() < 1.1 + 1e-9


@given(lines())
def test_pieces_cover_the_line_and_lie_flat(points: Points) -> None:
    pieces = Tape(points).pieces((0.5, 0.4, 0.3))
    assert len(pieces) == len(points)
    covered = np.zeros(11 * len(points), np.bool_)
    on_line = along(points, np.linspace(0, 1, 11))
    for piece in pieces:
        assert (piece.shape, piece.rgb) == ("box", (0.5, 0.4, 0.3))
        assert piece.centre_m[2] == piece.half_size_m[2] == THICK_M / 2, "on the floor"
        away = on_line - piece.centre_m[:2]
        cos, sin = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
        ahead = np.abs(away @ (cos, sin)) <= piece.half_size_m[0] - WIDTH_M / 2 + 1e-9
        covered |= ahead & (np.abs(away @ (-sin, cos)) <= 1e-9)
    assert covered.all()
    lengths = sum(2 * piece.half_size_m[0] - WIDTH_M for piece in pieces)
    assert math.isclose(lengths, length_m(points))


def test_level_with_an_outermost_corner_is_outside() -> None:
    diamond = Tape(np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]))
    assert not diamond.encloses(-0.5, 1.0)
    assert not diamond.encloses(-2.0, 0.0)
    assert diamond.encloses(-0.5, 0.0)
