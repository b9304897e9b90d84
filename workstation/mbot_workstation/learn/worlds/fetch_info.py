"""What an environment says beside observation and reward."""

import math
from typing import Any

from mbot_workstation.learn.worlds.fetch_world import FetchWorld
from mbot_workstation.tasks.fetch.run import Happening

HAPPENINGS = tuple(Happening)


def fetch_info(world: FetchWorld, happening: Happening = Happening.NOTHING) -> dict[str, Any]:
    """The info dictionary after a step.

    Keys: `touches` of the episode; `time_left_s` for this object; `happening` of the last step, as
    text; `border`, whether that was border contact; `lesson`, its name; `target_ahead_m` and
    `target_left_m`, where the object is as seen from the robot, for oracles and plots;
    `seen_left_rad`, in which direction the observation shows it, or would if it were in view; NaN
    for one that is older than the object.
    """
    ahead_m, left_m = target_from_robot(world)
    return {
        "touches": world.touches,
        "time_left_s": world.time_left_s,
        "happening": happening.value,
        "border": happening is Happening.BORDER,
        "lesson": world.lesson.name,
        "target_ahead_m": ahead_m,
        "target_left_m": left_m,
        "seen_left_rad": seen_left_rad(world),
    }


def target_from_robot(world: FetchWorld) -> tuple[float, float]:
    """How far ahead of the robot's axle and to its left the object is, in metres."""
    target, robot = world.target, world.robot
    dx, dy = target.x_m - robot.x_m, target.y_m - robot.y_m
    cos, sin = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
    return cos * dx + sin * dy, cos * dy - sin * dx


def seen_left_rad(world: FetchWorld) -> float:
    """Where the object was from the camera when the observation was taken, left positive.

    Pictures are old: in a turn this is not where the object is now. NaN while they still show the
    one that was touched.
    """
    if not world.glimpse_shows_target:
        return math.nan
    ahead_m, left_m = world.simulation.object_from_robot(world.glimpse.state)
    return math.atan2(left_m, ahead_m - world.simulation.robot.camera_mount.ahead_m)
