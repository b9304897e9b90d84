"""Seeded episodes of the task for one driver, and what they amount to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.drivers.contestants import Driver, driver
from mbot_workstation.learn.worlds.fetch_vec_env import FetchVecEnv
from mbot_workstation.learn.worlds.lessons import Lesson
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.scene.scene_parameters import SceneParameters

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
        touches: objects touched.
        completed: whether those were all.

    """

    reward: float
    decisions: int
    touches: int
    completed: bool


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean with its 95 % interval, from bootstrapping over episodes."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Score:
    """What a driver's episodes amount to; JSON as it is.

    Attributes:
        episodes: how many.
        reward, touches, length: an episode; length in decisions.
        success: share of episodes with all objects touched.
        decisions_per_object: all decisions, those of failed episodes too, by all touches; None
            without a touch.

    """

    episodes: int
    reward: Estimate
    touches: Estimate
    success: Estimate
    length: Estimate
    decisions_per_object: Estimate | None


@dataclass(frozen=True, slots=True)
class Trial:
    """How a driver is tried.

    Attributes:
        lesson: which task.
        preset: on which robots.
        rooms: panoramas, shape (h, 2 h, 3).
        episodes: how many.
        seed: of robots, rooms, objects and noise. Every driver meets the same at the beginning of
            its episodes; two seeds have none in common.
        workers: processes that simulate; None is one a core.
        robot, scene: what the preset starts from, and what is around it.

    """

    lesson: Lesson
    preset: EffectRanges
    rooms: Sequence[Picture]
    episodes: int = 100
    seed: int = 0
    workers: int | None = None
    robot: RobotParameters = field(default_factory=RobotParameters)
    scene: SceneParameters = field(default_factory=SceneParameters)


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
    driven = driver(contestant, robots, trial.seed, trial.preset, trial.robot)
    return evaluate_driver(driven, trial, ended)


def evaluate_driver(
    driven: Driver, trial: Trial, ended: Callable[[int], None] = lambda _: None
) -> list[EpisodeResult]:
    """Run the episodes of a driver of `robots_of(trial)` robots; see `evaluate`."""
    robots = robots_of(trial)
    environment = FetchVecEnv(
        robots=robots,
        seed=trial.seed * MOST_ROBOTS,  # robots count up from it: no two trials share one
        preset=trial.preset,
        lesson=trial.lesson,
        rooms=trial.rooms,
        workers=trial.workers,
        robot=trial.robot,
        scene=trial.scene,
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
    targets = _targets(environment.reset_infos)
    while any(len(done) < share for done, share in zip(results, shares, strict=True)):
        observations, _, dones, infos = environment.step(driven.act(observations, targets))
        driven.forget(dones)
        targets = _targets(infos)
        for robot in np.flatnonzero(dones):
            if len(results[robot]) < shares[robot]:
                results[robot].append(_result(infos[robot], trial.lesson))
                ended(sum(map(len, results)))
            targets[robot] = _targets([environment.reset_infos[robot]])[0]
    return [result for robot in results for result in robot]


def _result(info: dict[str, Any], lesson: Lesson) -> EpisodeResult:
    episode, touches = info["episode"], int(info["touches"])
    completed = touches >= lesson.objects
    return EpisodeResult(float(episode["r"]), int(episode["l"]), touches, completed)


def _targets(infos: Sequence[dict[str, Any]]) -> NDArray[np.float64]:
    unknown = float("nan")
    return np.array(
        [
            (info.get("target_ahead_m", unknown), info.get("target_left_m", unknown))
            for info in infos
        ]
    )


def score(results: Sequence[EpisodeResult]) -> Score:
    """Means with their confidence intervals, the same for the same results."""
    reward = np.array([result.reward for result in results])
    decisions = np.array([result.decisions for result in results], np.float64)
    touches = np.array([result.touches for result in results], np.float64)
    completed = np.array([result.completed for result in results], np.float64)
    ones = np.ones(len(results))
    return Score(
        episodes=len(results),
        reward=_ratio(reward, ones),
        touches=_ratio(touches, ones),
        success=_ratio(completed, ones),
        length=_ratio(decisions, ones),
        decisions_per_object=_ratio(decisions, touches) if touches.any() else None,
    )


def _ratio(above: NDArray[np.float64], below: NDArray[np.float64]) -> Estimate:
    """The ratio of two sums over episodes, with its bootstrap interval."""
    rng = np.random.default_rng(0)
    drawn = rng.integers(len(above), size=(RESAMPLES, len(above)))
    sums = below[drawn].sum(axis=1)
    some = sums > 0
    ratios = above[drawn].sum(axis=1)[some] / sums[some]
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(ratios, [tail, 1 - tail])
    mean = above.sum() / below.sum()
    return Estimate(round(float(mean), 4), round(float(low), 4), round(float(high), 4))
