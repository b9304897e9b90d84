"""What drivers that see no picture earn in a task, one nominal robot after the other."""

from dataclasses import dataclass

import numpy as np

from mbot_workstation.learn.drivers.contestants import Driver
from mbot_workstation.learn.evaluation.cheap_strategies import blind_driver, guide_driver
from mbot_workstation.learn.learning.guidance import GUIDE_REMEMBERS
from mbot_workstation.learn.worlds.world import World
from mbot_workstation.learn.worlds.world_settings import world_settings
from mbot_workstation.sim.effects.presets import NOMINAL
from mbot_workstation.tasks.find import find_task

from .small_world import ROOMS

ROBOTS = 8


@dataclass(frozen=True, slots=True)
class Drives:
    """Of a task's last lesson.

    Attributes:
        reward: a mean over episodes.
        largest: that the lesson can bring.
        counts: of what the task counts, by episode.

    """

    reward: float
    largest: float
    counts: tuple[int, ...]


def world_of(task: str, lesson: int = -1, seed: int = 0, preset: str = "ideal") -> World:
    """A world at the start of an episode of one of a task's lessons."""
    settings = world_settings(preset, find_task(task).lessons[lesson], ROOMS, task=task)
    world = World(settings)
    world.seed(np.random.default_rng(seed))
    world.begin(settings.lesson)
    return world


def drives(task: str, who: str, decisions: int = 400, robots: int = ROBOTS) -> Drives:
    """Let the task's guide, or somebody blind, drive an episode with each robot."""
    found, world = find_task(task), world_of(task, preset="nominal")
    rewards, counts = [], []
    for seed in range(robots):
        driver = guide_driver(found, 1, NOMINAL, GUIDE_REMEMBERS)
        driver = driver if who == "guide" else blind_driver(who, 1)
        assert driver is not None
        reward, count = _episode(world, driver, seed, decisions)
        rewards.append(reward)
        counts.append(count)
    return Drives(float(np.mean(rewards)), world.lesson.largest_reward, tuple(counts))


def _episode(world: World, driver: Driver, seed: int, decisions: int) -> tuple[float, int]:
    """What it earns, and counts."""
    world.seed(np.random.default_rng(seed))
    world.begin(world.lesson)
    info, reward = world.info(), 0.0
    for _ in range(decisions):
        left, right = driver.act(np.zeros((0, 64, 64, 3), np.uint8), [info])[0].tolist()
        outcome = world.decide(left, right)
        reward += outcome.reward
        info = world.info(outcome)
        if outcome.ended:
            break
    return reward, int(info[world.task.counted])
