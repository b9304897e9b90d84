"""What tests of the training environment share: small rooms, settings and a driven world."""

import numpy as np

from mbot_workstation.learn.worlds.world import World
from mbot_workstation.learn.worlds.world_settings import WorldSettings, world_settings
from mbot_workstation.sim.effects.effects import IDEAL, EffectRanges
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.tasks.lesson import Lesson

ROOMS = [generate_room(seed, width_px=64) for seed in (0, 1)]


def settings(
    lesson: str | Lesson = "10", /, **effects: float | tuple[float, float]
) -> WorldSettings:
    """Ideal robots but for these effects."""
    return world_settings(EffectRanges.fixed(IDEAL).changed(**effects), lesson, ROOMS)


def world(lesson: str | Lesson = "10", seed: int = 0, /, **effects: float) -> World:
    """A world at the start of an episode."""
    made = settings(lesson, **effects)
    result = World(made)
    result.seed(np.random.default_rng(seed))
    result.begin(made.lesson)
    return result


def steer_to_target(robot: World) -> tuple[float, float]:
    """What a driver that knows the poses does: turn towards the object, then go."""
    info = robot.info()
    ahead_m, left_m = info["target_ahead_m"], info["target_left_m"]
    bearing_rad = float(np.arctan2(left_m, ahead_m))
    if abs(bearing_rad) > 0.5:
        turn = float(np.clip(bearing_rad / 2.4, -1, 1))
        return -turn, turn
    return 1 - max(0.0, 0.4 * bearing_rad), 1 - max(0.0, -0.4 * bearing_rad)
