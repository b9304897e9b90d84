"""What the kit's sensors would tell of the floor and of what is ahead."""

import math

import pytest

from mbot_workstation.sim.body.feelers import FARTHEST_M, Feelers, Segment
from mbot_workstation.sim.pose import ORIGIN, Pose

KIT = Feelers()
WALL: Segment = ((1.0, -2.0), (1.0, 2.0))


def test_a_pair_sees_the_floor_below_it() -> None:
    edge_m = KIT.pairs[0][0]

    def table(x_m: float, y_m: float) -> bool:
        return x_m <= edge_m

    assert KIT.has_floor(ORIGIN, table) == (True, True)
    assert KIT.has_floor(Pose(0.001, 0.0), table) == (False, False)
    assert KIT.has_floor(Pose(0.0, 0.0, math.pi / 2), table) == (True, True)
    slant = Pose(0.0, 0.0, math.radians(-2.0))  # the left one comes first
    assert KIT.has_floor(slant, table) == (False, True)


def test_a_module_before_each_wheel_tells_for_its_side() -> None:
    wide = Feelers(pairs=((0.06, 0.05), (0.06, 0.06), (0.06, -0.05), (0.06, -0.06)))
    assert wide.has_floor(ORIGIN, lambda _, y_m: y_m < 0.055) == (False, True)


@pytest.mark.parametrize("ahead_m", [0.2, 0.9])
def test_an_echo_tells_how_far_a_wall_is(ahead_m: float) -> None:
    x_m = 1.0 - KIT.sonar[0] - ahead_m
    assert KIT.echo_m(Pose(x_m, 0.3), [WALL]) == pytest.approx(ahead_m, rel=0.001)


def test_nothing_comes_back_from_behind_from_afar_and_from_what_is_slanted() -> None:
    assert KIT.echo_m(ORIGIN, []) == 0
    assert KIT.echo_m(Pose(0.0, 0.0, math.pi), [WALL]) == 0
    assert KIT.echo_m(Pose(-FARTHEST_M, 0.0), [WALL]) == 0
    assert KIT.echo_m(Pose(0.5, 0.0, math.radians(30.0)), [WALL]) > 0
    assert KIT.echo_m(Pose(0.5, 0.0, math.radians(52.0)), [WALL]) == 0
    assert KIT.echo_m(ORIGIN, [((1.0, 0.5), (1.0, 2.0))]) == 0, "beside the cone"
