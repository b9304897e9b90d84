"""Some decisions in a row, in which nobody waits for anybody: planned, driven, and told of."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture

FloatArray = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class SegmentPlan:
    """What a worker's pilot is told. Chance is drawn by who collects, so that a seed gives the same
    run whoever is faster.

    Attributes:
        weights: the policy's from now on; None leaves them.
        noise: standard normal, shape (decisions, n, 2).
        forgets: who begins anew after each decision, shape (decisions, n), as after an episode.

    """

    weights: dict[str, NDArray[Any]] | None
    noise: FloatArray
    forgets: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class HiddenState:
    """What n robots go by besides their pictures.

    Attributes:
        state: of the memory, shape (n, units).
        previous_actions: what its wheels were told in the decision before, shape (n, 2).
        forgot: whether it begins anew, shape (n,).

    """

    state: FloatArray
    previous_actions: FloatArray
    forgot: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Decisions:
    """What was decided in a segment; shapes (decisions, n, ...).

    Attributes:
        states, previous_actions, forgot: the hidden state before each decision.
        actions: drawn, not clipped.
        wheels: what the wheels were told of them.
        known: what the actions were made of, (decisions, n, features + units).
        after: the hidden state now.

    """

    states: FloatArray
    previous_actions: FloatArray
    forgot: NDArray[np.bool_]
    actions: FloatArray
    wheels: FloatArray
    known: FloatArray
    after: HiddenState

    @classmethod
    def beside(cls, parts: Sequence[Self]) -> Self:
        """Of several workers, one beside the other."""
        names = [field.name for field in fields(cls) if field.name != "after"]
        after = [field.name for field in fields(HiddenState)]
        return cls(
            **{name: np.concatenate([getattr(one, name) for one in parts], 1) for name in names},
            after=HiddenState(
                *(np.concatenate([getattr(one.after, name) for one in parts]) for name in after)
            ),
        )


class Pilot(Protocol):
    """Decides for all robots of a worker, n of them; handed over by pickle, before it has begun."""

    def start(self, plan: SegmentPlan) -> None:
        """Begin a segment."""
        ...

    def decide(self, pictures: Picture) -> FloatArray:
        """Both wheels in [-1, 1], shape (n, 2), for what is seen, shape (n, 64, 64, 3)."""
        ...

    def arrive(self, ended: NDArray[np.bool_]) -> None:
        """Be told whose episodes the decision has ended, shape (n,)."""
        ...

    def decisions(self) -> Decisions:
        """All of the segment."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class SegmentShare:
    """A segment of one worker's robots, shape (decisions, n); pictures are in shared memory.

    Attributes:
        situations: step records at the moment that the pictures show.
        bodies: BODY_RECORD of the robots then.
        outcomes: step records of what each decision brought.
        decisions: the pilot's.

    """

    situations: NDArray[np.void]
    bodies: NDArray[np.void]
    outcomes: NDArray[np.void]
    decisions: Decisions


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A segment of all robots; shapes (decisions, n, ...).

    Attributes:
        pictures: uint8, what was seen; overwritten when robots drive the segment after next.
        situations, bodies: step records and BODY_RECORD at the moment that they show.
        rewards: of the decisions.
        ended: whether they ended episodes; what is seen next is of other ones.
        infos: for each decision those of the episodes that it ended.
        decisions: the pilots'.

    """

    pictures: NDArray[np.uint8]
    situations: NDArray[np.void]
    bodies: NDArray[np.void]
    rewards: FloatArray
    ended: NDArray[np.bool_]
    infos: list[list[dict[str, Any]]]
    decisions: Decisions
