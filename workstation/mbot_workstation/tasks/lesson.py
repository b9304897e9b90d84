"""A stage of a curriculum: which robots meet it. What it asks of them each task adds."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Self

import numpy as np

from mbot_protocol.did_you_mean import did_you_mean
from mbot_workstation.sim.effects.effects import EffectRanges, RealWorldEffects

Kind = tuple[tuple[str, tuple[float, float]], ...]
"""Robots that differ from a preset: ranges by the effect's name."""

USUAL: Kind = ()


@dataclass(frozen=True, slots=True)
class Lesson:
    """One stage of a curriculum.

    Attributes:
        name: what tables and curves call it.
        kinds: of robots; each episode draws one. What differs from the preset: ranges by the
            effect's name.
        changes: share of episodes in which the robot's motors, its grip or its camera's latency
            become other ones on the way (`world.CHANGING`).
        change_after: decisions until then, drawn evenly from this range.
        change_to: what it becomes, as a kind; None draws another robot of this lesson.
        lookalikes: share of what is not the object, in an arena of any look, that has nearly its
            colour (`scene_looks.draw_look`).
        needs_training: whether only a trained policy, or a guide, gets anywhere in it.

    """

    name: str
    _: KW_ONLY
    kinds: tuple[Kind, ...] = (USUAL,)
    changes: float = 0.0
    change_after: tuple[int, int] = (10, 120)
    change_to: Kind | None = None
    lookalikes: float = 0.0
    needs_training: bool = False

    @property
    def goal(self) -> int:
        """How many of what the task counts make a complete run."""
        return 1

    @property
    def largest_reward(self) -> float:
        """Of an episode."""
        return float(self.goal)

    def draw_robot(self, ranges: EffectRanges, rng: np.random.Generator) -> RealWorldEffects:
        """A robot for one episode, of one of this lesson's kinds and otherwise in these ranges."""
        several = len(self.kinds) > 1
        kind = self.kinds[int(rng.integers(len(self.kinds))) if several else 0]
        return ranges.changed(**dict(kind)).sample(rng)

    def draw_change(
        self, ranges: EffectRanges, rng: np.random.Generator
    ) -> tuple[int, RealWorldEffects] | None:
        """After which decision of this episode the robot becomes which other one, if it does."""
        if self.changes == 0 or rng.random() >= self.changes:
            return None
        if self.change_to is None:
            other = self.draw_robot(ranges, rng)
        else:
            other = ranges.changed(**dict(self.change_to)).sample(rng)
        return int(rng.integers(*self.change_after)), other

    def moved(self, origin: RealWorldEffects, to: RealWorldEffects) -> Self:
        """The same lesson with its kinds around another robot, as `EffectRanges.moved`."""
        return replace(self, kinds=tuple(_moved(kind, origin, to) for kind in self.kinds))


def _moved(kind: Kind, origin: RealWorldEffects, to: RealWorldEffects) -> Kind:
    ranges = EffectRanges.fixed(origin).changed(**dict(kind)).moved(origin, to)
    return tuple(
        (name, (getattr(ranges.low, name), getattr(ranges.high, name))) for name, _ in kind
    )


def lesson_named(lessons: Sequence[Lesson], name: str) -> Lesson:
    """Look a lesson up.

    Raises:
        ValueError: there is none of this name.

    """
    by_name = {lesson.name: lesson for lesson in lessons}
    if name not in by_name:
        meant = did_you_mean(name, by_name)
        raise ValueError(f"no lesson {name!r}, expected one of {', '.join(by_name)}{meant}")
    return by_name[name]


def lessons_named(lessons: Sequence[Lesson], selection: Sequence[str]) -> tuple[str, ...]:
    """The names that a selection stands for: ("1-3", "rough") is 1, 2, 3 and rough.

    Raises:
        ValueError: there is no such lesson, or a range does not rise in the task's order.

    """
    order = [lesson.name for lesson in lessons]
    names: list[str] = []
    for text in selection:
        first, dash, last = text.partition("-")
        if not dash or text in order:
            names.append(lesson_named(lessons, text).name)
        elif first in order and last in order[order.index(first) :]:
            names += order[order.index(first) : order.index(last) + 1]
        else:
            raise ValueError(f"lessons {text!r}, expected a rising range such as 1-10")
    return tuple(names)
