"""What cheap strategies earn in a task, beside its guide: to be known before a night of training.

A policy learns whatever pays. Where standing, spinning or shuttling pays more than what the task is
meant for, that is what it learns; so such a task is refused, with the figures (docs/tasks.md).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.drivers.contestants import RANDOM, SERVO, Driver, driver
from mbot_workstation.learn.evaluation.cheap_strategies import WHEELS, blind_driver, guide_driver
from mbot_workstation.learn.learning.curriculum import GUIDED_MARK
from mbot_workstation.learn.learning.guidance import GUIDE_REMEMBERS
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.effects.presets import NOMINAL
from mbot_workstation.tasks.episode import NOTHING
from mbot_workstation.tasks.find import find_task
from mbot_workstation.tasks.lesson import Lesson
from mbot_workstation.tasks.task import Task

GUIDE = "guide"
ROBOTS = 16
"""At once, an episode each."""

MOST_DECISIONS = 400
"""Of an episode, 160 s; what it has earned until then counts."""

REACHED = GUIDED_MARK.share
"""Of a lesson's largest reward: there a training with a guide goes on to the next one."""


@dataclass(frozen=True, slots=True)
class Earned:
    """What one driver made of a lesson, a mean over episodes.

    Attributes:
        driver: its name.
        lesson: likewise.
        reward: of an episode.
        spread: the standard error of that.
        by_happening: what came with each happening, `nothing` being what every decision is paid.
        count: of what the task counts.
        decisions: an episode's length.
        in_view: share of pictures that show what matters; None where the task does not say.

    """

    driver: str
    lesson: str
    reward: float
    spread: float
    by_happening: Mapping[str, float]
    count: float
    decisions: float
    in_view: float | None


@dataclass(frozen=True, slots=True)
class TaskCheck:
    """What was found; JSON as it is.

    Attributes:
        task: its name.
        earned: by driver and lesson.
        faults: what it is refused for.
        notes: what its author should know.

    """

    task: str
    earned: tuple[Earned, ...]
    faults: tuple[str, ...]
    notes: tuple[str, ...]


def check_task(
    reference: str,
    rooms: Sequence[Picture],
    seed: int,
    tried: Callable[[int], None],
    workers: int | None = None,
) -> TaskCheck:
    """Let everybody drive: in the last lesson all, in the others the guide.

    Args:
        reference: the task's name or file.
        rooms: panoramas to drive in.
        seed: of robots, rooms and objects.
        tried: called with the number of trials that have ended.
        workers: processes that simulate; None is one a core.

    """
    task = find_task(reference)
    earned: list[Earned] = []
    trials = trials_of(task)
    with TaskVecEnv(
        ROBOTS, preset="nominal", lesson=trials[0][1], rooms=rooms, workers=workers, task=reference
    ) as environment:
        for name, lesson in trials:
            environment.set_lesson(lesson)
            environment.seed(seed * ROBOTS)  # the same robots and objects for all
            earned.append(_earned(name, lesson, _driver(name, task, seed), environment))
            tried(len(earned))
    return TaskCheck(task.name, tuple(earned), *_verdict(task, course_of(task), earned))


def course_of(task: Task) -> list[Lesson]:
    """The lessons that are tried: those that need no trained policy, if there are any."""
    return [one for one in task.lessons if not one.needs_training] or list(task.lessons)


def trials_of(task: Task) -> list[tuple[str, Lesson]]:
    """Who drives in which lesson."""
    course = course_of(task)
    guides = [(GUIDE, one) for one in course] if _driver(GUIDE, task, 0) else []
    return [*guides, *((name, course[-1]) for name in (*WHEELS, RANDOM, SERVO))]


def _driver(name: str, task: Task, seed: int) -> Driver | None:
    if name == GUIDE:
        return guide_driver(task, ROBOTS, NOMINAL, GUIDE_REMEMBERS)
    if name in WHEELS:
        return blind_driver(name, ROBOTS)
    return driver(name, ROBOTS, seed, NOMINAL)


def _earned(name: str, lesson: Lesson, driven: Driver | None, environment: TaskVecEnv) -> Earned:
    """Everybody's first episode, as far as it goes."""
    assert driven is not None
    task = environment.task
    pictures: Any = environment.reset()
    told: list[dict[str, Any]] = list(environment.reset_infos)
    going = np.ones(ROBOTS, np.bool_)
    rewards, lengths, counts = (np.zeros(ROBOTS) for _ in range(3))
    shares, shown, looked = dict[str, float](), 0, 0
    for _ in range(MOST_DECISIONS):
        if task.sight is not None:
            seen = task.sight.shown(_facts(task, told))[going, 0]
            shown, looked = shown + int(seen.sum()), looked + len(seen)
        pictures, paid, ended, infos = environment.step(driven.act(pictures, told))
        told = list(infos)
        for robot in np.flatnonzero(going):
            happening = str(told[robot]["happening"])
            shares[happening] = shares.get(happening, 0.0) + float(paid[robot])
            rewards[robot] += paid[robot]
            lengths[robot] += 1
            counts[robot] = told[robot][task.counted]
        driven.forget(ended)
        for robot in np.flatnonzero(ended):
            told[robot] = environment.reset_infos[robot]
        going &= ~ended
        if not going.any():
            break
    return Earned(
        name,
        lesson.name,
        round(float(rewards.mean()), 3),
        round(float(rewards.std() / math.sqrt(ROBOTS)), 3),
        {what: round(share / ROBOTS, 3) for what, share in sorted(shares.items()) if share},
        round(float(counts.mean()), 2),
        round(float(lengths.mean()), 1),
        round(shown / looked, 3) if looked else None,
    )


def _facts(task: Task, infos: Sequence[Mapping[str, Any]]) -> "np.ndarray[Any, np.dtype[np.void]]":
    names = task.facts.names or ()
    return np.array([tuple(info[name] for name in names) for info in infos], task.facts)


def _verdict(
    task: Task, course: Sequence[Lesson], earned: Sequence[Earned]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Faults and notes."""
    last = course[-1]
    here = {one.driver: one for one in earned if one.lesson == last.name}
    guided = {one.lesson: one for one in earned if one.driver == GUIDE}
    cheap = [here[name] for name in (*WHEELS, RANDOM)]
    best = max(cheap, key=lambda one: one.reward)
    faults: list[str] = []
    notes: list[str] = []
    if odd := [one for one in earned if not math.isfinite(one.reward)]:
        faults.append(
            f"{odd[0].driver} was paid {odd[0].reward} in lesson {odd[0].lesson}: a reward has to "
            "be a finite number"
        )
    if last.name in guided:
        guide = guided[last.name]
        if best.reward >= guide.reward:
            faults.append(
                f"{best.driver} earns {best.reward:.2f} an episode ({_made_of(best)}), the guide "
                f"{guide.reward:.2f} ({_made_of(guide)}): that is what would be learned"
            )
        for lesson in course:
            if guided[lesson.name].reward < REACHED * lesson.largest_reward:
                notes.append(
                    f"lesson {lesson.name}: the guide earns {guided[lesson.name].reward:.2f} of "
                    f"{lesson.largest_reward:g}, a training goes on at "
                    f"{REACHED * lesson.largest_reward:.2f}"
                )
    else:
        notes.append(
            f"it has no guide to compare with; {best.driver} earns most of the cheap ones, "
            f"{best.reward:.2f} of {last.largest_reward:g} ({_made_of(best)})"
        )
        if best.reward >= REACHED * last.largest_reward:
            faults.append(
                f"{best.driver} earns {best.reward:.2f} of {last.largest_reward:g} "
                f"({_made_of(best)}): that is what would be learned"
            )
    looked = [one.in_view for one in earned if one.in_view is not None]
    if looked and not any(looked):
        faults.append("no picture of any driver shows what the task is about")
    return tuple(faults), tuple(notes)


def _made_of(one: Earned) -> str:
    """What a reward is made of, in words."""
    parts = [
        f"{share:+.2f} {'every decision' if what == NOTHING else what}"
        for what, share in one.by_happening.items()
    ]
    return ", ".join(parts) or "nothing at all"
