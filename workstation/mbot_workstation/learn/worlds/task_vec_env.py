"""Many robots at once for stable-baselines3: one process a core, frames in shared memory."""

import os
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.worlds.segment import Decisions, Pilot, Segment, SegmentPlan
from mbot_workstation.learn.worlds.shared_arrays import FRAME_SHAPE, SEGMENT, SLOTS
from mbot_workstation.learn.worlds.task_env import action_space, observation_space
from mbot_workstation.learn.worlds.worker import (
    DriveSegment,
    Reset,
    SetLesson,
    SetPilot,
    StepAll,
    Survey,
)
from mbot_workstation.learn.worlds.worker_pool import WorkerPool
from mbot_workstation.learn.worlds.world import info_of
from mbot_workstation.learn.worlds.world_settings import world_settings
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task
from mbot_workstation.tasks.lesson import Lesson, lesson_named


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """What all robots see, and what is true at the moment that it shows.

    Attributes:
        pictures: uint8, shape (n, 64, 64, 3).
        situations: step records, shape (n,).
        bodies: BODY_RECORD of the robots that they come from, shape (n,).

    """

    pictures: NDArray[np.uint8]
    situations: NDArray[np.void]
    bodies: NDArray[np.void]


class TaskVecEnv(VecEnv):
    """`TaskEnv` many times over; robot i is `TaskEnv` reset with `seed` + i, bit for bit.

    Close it, or use it in a `with`. A worker that dies or fails makes the next call raise, as
    `WorkerPool.wait` does.

    Attributes:
        shares: the rows of each worker.
        task: what the robots are to do.

    """

    def __init__(
        self,
        robots: int = 16,
        seed: int = 0,
        preset: str | EffectRanges = "nominal",
        lesson: str | Lesson = "1",
        rooms: Sequence[Picture] | None = None,
        workers: int | None = None,
        robot: RobotParameters | None = None,
        scene: SceneParameters | None = None,
        task: str = DEFAULT_TASK,
    ) -> None:
        """Start the workers.

        Args:
            robots: how many.
            seed: of the first; the others count up.
            preset: the effects, by name or as ranges.
            lesson: to start with, by name or as itself.
            rooms: panoramas, shape (h, 2 h, 3), RGB; generated when None.
            workers: processes; one for each core this process may use when None.
            robot: what the effects start from; the nominal one when None.
            scene: what is around it; likewise.
            task: by its name or file.

        """
        if robots < 1:
            raise ValueError(f"robots is {robots}, expected at least 1")
        settings = world_settings(preset, lesson, rooms, robot, scene, task)
        self.task = find_task(task)
        workers = len(os.sched_getaffinity(0)) if workers is None else workers
        self._pool = WorkerPool(robots, max(1, min(workers, robots)), settings)
        self._arrays = self._pool.arrays
        self.shares = self._pool.shares
        self._driving: deque[tuple[int, int, int]] = deque()  # request, decisions, slot
        self._slot = 0
        self._lessons = [settings.lesson]
        self._returns = np.zeros(robots)
        self._lengths = np.zeros(robots, np.int64)
        self._start_s = time.monotonic()
        super().__init__(robots, observation_space(), action_space())
        self.seed(seed)

    def observations(self) -> Observations:
        """What the robots see now: copied; they must not be driving."""
        arrays = self._arrays
        return Observations(arrays.frames.copy(), arrays.now.copy(), arrays.bodies.copy())

    @property
    def lesson(self) -> Lesson:
        """Of episodes that start now."""
        return self._lessons[-1]

    def set_lesson(self, lesson_or_name: str | Lesson) -> None:
        """Give a lesson to every episode that starts from now on; running ones go on as they are.

        `info["lesson"]` says which lesson an episode belonged to.
        """
        new = (
            lesson_named(self.task.lessons, lesson_or_name)
            if isinstance(lesson_or_name, str)
            else lesson_or_name
        )
        if new == self.lesson:
            return
        self._lessons.append(new)
        self._pool.ask([SetLesson(new, len(self._lessons) - 1)] * len(self.shares))

    def reset(self) -> NDArray[np.uint8]:
        """Start new episodes with all robots. Shape (robots, 64, 64, 3)."""
        self._settle()
        seeds = self._seeds
        self._pool.ask([Reset(tuple(seeds[row] for row in share)) for share in self.shares])
        self._pool.wait()
        self._reset_seeds()
        self._reset_options()
        self._returns[:] = 0
        self._lengths[:] = 0
        self.reset_infos = [self._info(first) for first in self._arrays.now.tolist()]
        return self._arrays.frames.copy()

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Let all robots drive; shape (robots, 2)."""
        self._settle()
        self._arrays.actions[:] = actions
        self._pool.ask([StepAll()] * len(self.shares))

    def step_wait(self) -> VecEnvStepReturn:
        """Wait for them; observations, rewards, whether episodes ended, infos."""
        self._pool.wait()
        records = self._arrays.records
        rewards, ended = records["reward"].copy(), records["ended"].copy()
        infos = [self._info(record) for record in records.tolist()]
        for row, episode in self._count(rewards, ended).items():
            self.reset_infos[row] = self._info(self._arrays.now[row].item())
            infos[row]["terminal_observation"] = self._arrays.last_frames[row].copy()
            infos[row] |= episode
        # A copy: stable-baselines3 still needs these when the next ones are written.
        return self._arrays.frames.copy(), rewards, ended, infos

    def set_pilot(self, pilot: Pilot) -> None:
        """Give each worker a pilot of its own, made as this one is."""
        self._pool.ask([SetPilot(pilot)] * len(self.shares))

    def drive(self, decisions: int, plans: Sequence[SegmentPlan]) -> None:
        """Let pilots drive, SEGMENT decisions at most; what comes of it `arrive` tells later.

        Args:
            decisions: how many.
            plans: for each worker's pilot.

        """
        if len(self._driving) == SLOTS:
            raise RuntimeError(f"{SLOTS} segments are being driven already: arrive first")
        requests = [DriveSegment(decisions, self._slot, plan) for plan in plans]
        self._driving.append((self._pool.ask(requests), decisions, self._slot))
        self._slot = (self._slot + 1) % SLOTS

    def arrive(self) -> Segment:
        """Wait for the first of the segments that are being driven."""
        number, decisions, slot = self._driving.popleft()
        shares = [done.segment for done in self._pool.wait(number) if done.segment is not None]
        situations, bodies, outcomes = (
            np.concatenate([getattr(share, name) for share in shares], axis=1)
            for name in ("situations", "bodies", "outcomes")
        )
        rewards, ended = outcomes["reward"], outcomes["ended"]
        return Segment(
            pictures=self._arrays.segments[slot, :decisions],
            situations=situations,
            bodies=bodies,
            rewards=rewards,
            ended=ended,
            infos=[
                [
                    self._info(outcomes[decision, row].item()) | episode
                    for row, episode in self._count(rewards[decision], ended[decision]).items()
                ]
                for decision in range(decisions)
            ],
            decisions=Decisions.beside([share.decisions for share in shares]),
        )

    def survey(self, pictures: int) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.void]]]:
        """Pictures taken from anywhere, and what is true of each; `reset` before anybody drives.

        Args:
            pictures: about how many, in all.

        Yields:
            Some hundred pictures, shape (n, 64, 64, 3), and their step records, shape (n,).

        """
        self.reset()
        rounds = max(1, round(pictures / self.num_envs))
        sizes = [min(SEGMENT, rounds - start) for start in range(0, rounds, SEGMENT)]
        asked: deque[tuple[int, int, int]] = deque()
        for number in range(len(sizes) + 1):
            if number < len(sizes):
                slot = number % SLOTS
                orders = [Survey(sizes[number], slot)] * len(self.shares)
                asked.append((self._pool.ask(orders), sizes[number], slot))
            if number:  # one is under way while another is looked at
                request, size, slot = asked.popleft()
                told = [done.shown for done in self._pool.wait(request) if done.shown is not None]
                seen = self._arrays.segments[slot, :size].reshape(-1, *FRAME_SHAPE).copy()
                yield seen, np.concatenate(told, axis=1).ravel()

    def halt(self) -> None:
        """Wait for all that are driving, and forget what it brought."""
        while self._driving:
            self.arrive()

    def _settle(self) -> None:
        """Wait for what an interrupted caller has left."""
        self._pool.wait()
        self._driving.clear()

    def _count(
        self, rewards: NDArray[np.float32], ended: NDArray[np.bool_]
    ) -> dict[int, dict[str, Any]]:
        """Count a decision of all robots; by row, what is told of episodes that it ended."""
        self._returns += rewards
        self._lengths += 1
        return {row: self._end_episode(row) for row in np.flatnonzero(ended).tolist()}

    def close(self) -> None:
        """End the workers; a second time does nothing."""
        self._pool.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute that is the same for all: `render_mode`, `lesson`, the spaces."""
        if attr_name == "render_mode":
            value = None
        elif attr_name in ("lesson", "observation_space", "action_space"):
            value = getattr(self, attr_name)
        else:
            raise AttributeError(f"the robots have no {attr_name!r} that could be read from here")
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Not offered: `set_lesson` is what can be changed."""
        raise NotImplementedError("use set_lesson; everything else is set when it is made")

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Not offered: the robots live in other processes."""
        raise NotImplementedError(f"no {method_name!r}: the robots live in other processes")

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """As if wrapped in a Monitor, since ended episodes come with its `episode` info."""
        return [wrapper_class is Monitor for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[Picture | None]:
        """The last observations."""
        return list(self._arrays.frames.copy())

    def __enter__(self) -> "TaskVecEnv":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _info(self, record: tuple[Any, ...]) -> dict[str, Any]:
        _, _, happening, lesson, *facts = record
        what = self.task.happenings[happening]
        return info_of(self.task, facts, what, self._lessons[lesson].name)

    def _end_episode(self, row: int) -> dict[str, Any]:
        episode = {
            "r": float(self._returns[row]),
            "l": int(self._lengths[row]),
            "t": round(time.monotonic() - self._start_s, 6),
        }
        self._returns[row] = 0
        self._lengths[row] = 0
        return {"TimeLimit.truncated": False, "episode": episode}
