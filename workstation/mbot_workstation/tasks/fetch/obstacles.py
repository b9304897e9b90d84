"""Things in the way that are not the object: being touched, hiding it, how to drive around them."""

import math
from collections.abc import Sequence

from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Standing

BERTH_M = 0.07
"""How much room a guide leaves beside a thing."""

HIDES = 0.8
"""Of a thing's radius and of the object's height: less of it hides nothing."""


def way_to_things_m(robot: Pose, things: Sequence[Standing], robot_radius_m: float) -> float:
    """How far it is to the nearest, for a robot that is a circle; below 0 while it touches."""
    return min(
        (
            math.hypot(robot.x_m - thing.x_m, robot.y_m - thing.y_m)
            - thing.radius_m
            - robot_radius_m
            for thing in things
        ),
        default=math.inf,
    )


def is_hidden(eye: Pose, target: Pose, things: Sequence[Standing], object_height_m: float) -> bool:
    """Whether a thing stands between the camera and the object."""
    for thing in things:
        if thing.height_m >= HIDES * object_height_m:
            along, beside, way = _beside(eye, target, thing)
            if 0 < along < way and abs(beside) < HIDES * thing.radius_m:
                return True
    return False


def aim_around(
    robot: Pose, target: Pose, things: Sequence[Standing], robot_radius_m: float
) -> Pose:
    """Where to drive first: the object, or past the thing that stands nearest in the way."""
    nearest, best = math.inf, target
    for thing in things:
        along, beside, way = _beside(robot, target, thing)
        room_m = thing.radius_m + robot_radius_m + BERTH_M
        if not (0 < along < way and abs(beside) < room_m and along < nearest):
            continue
        nearest = along
        dx, dy = thing.x_m - robot.x_m, thing.y_m - robot.y_m
        away = math.hypot(dx, dy)
        # The tangent to the room that it needs, on the side that is nearer to the straight way.
        turn = math.asin(min(1.0, room_m / max(away, 1e-6)))
        heading = math.atan2(dy, dx) + (turn if beside < 0 else -turn)
        ahead_m = max(math.sqrt(max(away**2 - room_m**2, 0.0)), 0.3)
        best = Pose(
            robot.x_m + ahead_m * math.cos(heading),
            robot.y_m + ahead_m * math.sin(heading),
            target.yaw_rad,
        )
    return best


def _beside(start: Pose, end: Pose, thing: Standing) -> tuple[float, float, float]:
    """How far along the way a thing is, how far to the left of it, and how long the way is."""
    dx, dy = end.x_m - start.x_m, end.y_m - start.y_m
    way = max(math.hypot(dx, dy), 1e-9)
    to_x, to_y = thing.x_m - start.x_m, thing.y_m - start.y_m
    return (to_x * dx + to_y * dy) / way, (dx * to_y - dy * to_x) / way, way
