import math

from hypothesis import assume, given
from hypothesis import strategies as st

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.tasks.fetch.obstacles import (
    BERTH_M,
    aim_around,
    is_hidden,
    way_to_things_m,
)

ROBOT_M = 0.09
place = st.floats(-2.5, 2.5)
TALL = Standing("bottle", 1.0, 0.0, 0.05, 0.25)


@given(place, place, place, place, st.floats(0.03, 0.2))
def test_nobody_who_drives_where_he_is_told_meets_the_thing(
    x: float, y: float, thing_x: float, thing_y: float, radius: float
) -> None:
    robot, target = ORIGIN, Pose(x, y)
    thing = Standing("pot", thing_x, thing_y, radius, 0.2)
    room_m = radius + ROBOT_M
    assume(math.hypot(thing_x, thing_y) > room_m + BERTH_M + 0.01)
    assume(math.hypot(thing_x - x, thing_y - y) > room_m + BERTH_M)
    for _ in range(200):
        aim = aim_around(robot, target, (thing,), ROBOT_M)
        away = math.hypot(aim.x_m - robot.x_m, aim.y_m - robot.y_m)
        if math.hypot(target.x_m - robot.x_m, target.y_m - robot.y_m) < 0.03:
            break
        step = min(0.02, away) / max(away, 1e-9)
        robot = Pose(
            robot.x_m + step * (aim.x_m - robot.x_m), robot.y_m + step * (aim.y_m - robot.y_m)
        )
        assert way_to_things_m(robot, (thing,), ROBOT_M) > 0
    else:
        raise AssertionError(f"never gets there: {robot}")


def test_what_is_not_in_the_way_changes_nothing() -> None:
    target = Pose(2.0, 0.0, 0.7)
    beside = Standing("ball", 1.0, 0.5, 0.05, 0.1)
    behind = Standing("ball", 2.5, 0.0, 0.05, 0.1)
    assert aim_around(ORIGIN, target, (beside, behind), ROBOT_M) is target


def test_only_what_is_tall_enough_and_between_hides_the_object() -> None:
    target = Pose(2.0, 0.0)
    flat = Standing("book", 1.0, 0.0, 0.1, 0.03)
    assert is_hidden(ORIGIN, target, (TALL,), 0.1)
    assert not is_hidden(ORIGIN, target, (flat,), 0.1)
    assert not is_hidden(ORIGIN, Pose(0.9, 0.0), (TALL,), 0.1)
    assert not is_hidden(ORIGIN, Pose(2.0, 0.5), (TALL,), 0.1)


def test_the_way_to_things_is_to_the_nearest() -> None:
    far = Standing("pot", 0.0, 3.0, 0.2, 0.2)
    assert way_to_things_m(ORIGIN, (far, TALL), ROBOT_M) == 1.0 - 0.05 - ROBOT_M
    assert way_to_things_m(ORIGIN, (), ROBOT_M) == math.inf
