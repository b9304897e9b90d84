"""Seeded episodes of the task for one driver, and what they amount to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.drivers.contestants import Driver, driver
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task
from mbot_workstation.tasks.lesson import Lesson

MOST_ROBOTS = 16
"""At once; more would only cost memory."""

RESAMPLES = 2000
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """One episode.

    Attributes:
        reward: its sum.
        decisions: its length.
        count: of what the task counts.
        completed: whether those were all.
        mistakes: how often each of the task's was made.

    """

    reward: float
    decisions: int
    count: int
    completed: bool
    mistakes: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean with its 95 % interval, from bootstrapping over episodes."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Score:
    """What a driver's episodes amount to.

    Attributes:
        episodes: how many.
        reward, count, length: an episode; count of what the task counts, length in decisions.
        success: share of complete episodes.
        decisions_per_count: all decisions, those of failed episodes too, by all counts; None
            without one.
        mistakes: an episode, of each kind.

    """

    episodes: int
    reward: Estimate
    count: Estimate
    success: Estimate
    length: Estimate
    decisions_per_count: Estimate | None
    mistakes: Mapping[str, Estimate] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Trial:
    """How a driver is tried.

    Attributes:
        lesson: of its task.
        preset: on which robots.
        rooms: panoramas, shape (h, 2 h, 3).
        episodes: how many.
        seed: of robots, rooms, objects and noise. Every driver meets the same at the beginning of
            its episodes; two seeds have none in common.
        workers: processes that simulate; None is one a core.
        robot, scene: what the preset starts from, and what is around it.
        task: by its name or file.

    """

    lesson: Lesson
    preset: EffectRanges
    rooms: Sequence[Picture]
    episodes: int = 100
    seed: int = 0
    workers: int | None = None
    robot: RobotParameters = field(default_factory=RobotParameters)
    scene: SceneParameters = field(default_factory=SceneParameters)
    task: str = DEFAULT_TASK


def robots_of(trial: Trial) -> int:
    """How many are driven at once."""
    return min(MOST_ROBOTS, trial.episodes)


def evaluate(
    contestant: str, trial: Trial, ended: Callable[[int], None] = lambda _: None
) -> list[EpisodeResult]:
    """Run a driver's episodes.

    Args:
        contestant: see `driver`.
        trial: how it is tried; the same trial gives the same episodes.
        ended: called with the number of episodes that have ended.

    """
    robots = robots_of(trial)
    # Before anything slow: a path may be wrong.
    driven = driver(contestant, robots, trial.seed, trial.preset, trial.robot, trial.task)
    return evaluate_driver(driven, trial, ended)


def evaluate_driver(
    driven: Driver, trial: Trial, ended: Callable[[int], None] = lambda _: None
) -> list[EpisodeResult]:
    """Run the episodes of a driver of `robots_of(trial)` robots; see `evaluate`."""
    robots = robots_of(trial)
    environment = TaskVecEnv(
        robots=robots,
        seed=trial.seed * MOST_ROBOTS,  # robots count up from it: no two trials share one
        preset=trial.preset,
        lesson=trial.lesson,
        rooms=trial.rooms,
        workers=trial.workers,
        robot=trial.robot,
        scene=trial.scene,
        task=trial.task,
    )
    try:
        return _episodes(environment, driven, trial, ended)
    finally:
        environment.close()


def _episodes(
    environment: VecEnv, driven: Driver, trial: Trial, ended: Callable[[int], None]
) -> list[EpisodeResult]:
    robots = environment.num_envs
    # Every robot has its share. To take the first that end would prefer short episodes.
    shares = [len(range(robot, trial.episodes, robots)) for robot in range(robots)]
    results: list[list[EpisodeResult]] = [[] for _ in range(robots)]
    observations: Any = environment.reset()
    told: list[dict[str, Any]] = list(environment.reset_infos)
    while any(len(done) < share for done, share in zip(results, shares, strict=True)):
        observations, _, dones, infos = environment.step(driven.act(observations, told))
        driven.forget(dones)
        told = list(infos)
        for robot in np.flatnonzero(dones):
            if len(results[robot]) < shares[robot]:
                results[robot].append(_result(infos[robot], trial))
                ended(sum(map(len, results)))
            told[robot] = environment.reset_infos[robot]
    return [result for robot in results for result in robot]


def _result(info: dict[str, Any], trial: Trial) -> EpisodeResult:
    task, episode = find_task(trial.task), info["episode"]
    count = int(info[task.counted])
    mistakes = {name: int(info[name]) for name in task.mistakes}
    completed = count >= trial.lesson.goal
    return EpisodeResult(float(episode["r"]), int(episode["l"]), count, completed, mistakes)


def score(results: Sequence[EpisodeResult]) -> Score:
    """Means with their confidence intervals, the same for the same results."""
    reward = np.array([result.reward for result in results])
    decisions = np.array([result.decisions for result in results], np.float64)
    counts = np.array([result.count for result in results], np.float64)
    completed = np.array([result.completed for result in results], np.float64)
    ones = np.ones(len(results))
    return Score(
        episodes=len(results),
        reward=ratio(reward, ones),
        count=ratio(counts, ones),
        success=ratio(completed, ones),
        length=ratio(decisions, ones),
        decisions_per_count=ratio(decisions, counts) if counts.any() else None,
        mistakes={
            name: ratio(np.array([one.mistakes[name] for one in results], np.float64), ones)
            for name in results[0].mistakes
        },
    )


def ratio(above: NDArray[np.float64], below: NDArray[np.float64]) -> Estimate:
    """The ratio of two sums over n episodes (or drives), with its bootstrap interval."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(above), size=(RESAMPLES, len(above)))
    sums = below[drawn].sum(axis=1)
    some = sums > 0
    ratios = above[drawn].sum(axis=1)[some] / sums[some]
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(ratios, [tail, 1 - tail])
    mean = above.sum() / below.sum()
    return Estimate(round(float(mean), 4), round(float(low), 4), round(float(high), 4))
