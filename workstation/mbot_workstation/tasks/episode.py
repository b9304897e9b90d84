"""One run of a task, and what it is told: the values that pass between a world and a task."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.sim.scene.target_object import Footprint

DECISION_S = 0.4
"""The paper decides 2.5 times a second."""

NOTHING = "nothing"
"""The first of every task's happenings."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What an episode is played with.

    Attributes:
        contact_radius_m: the robot's body, a circle about the axle's centre.
        border_m: a robot at this |x| or |y| has left the arena.
        footprints: of the scene's objects, as large as they are drawn.
        standing: things in the robot's way that are none of them.

    """

    contact_radius_m: float
    border_m: float
    footprints: tuple[Footprint, ...]
    standing: tuple[Standing, ...] = ()


@dataclass(frozen=True, slots=True)
class Moment:
    """A decision that is about to be made. Pictures are old: the robot was elsewhere then.

    Attributes:
        robot: where it is now.
        now_s: since the episode began.
        seen_from: where the robot was when the picture was taken.
        seen_s: when that was.
        camera_ahead_m: from the axle to the camera.

    """

    robot: Pose
    now_s: float
    seen_from: Pose
    seen_s: float
    camera_ahead_m: float


@dataclass(frozen=True, slots=True)
class Step:
    """What a piece of driving brought.

    Attributes:
        happening: one of the task's; NOTHING mostly.
        score: what it was worth; 0 if nothing happened.
        ended: whether the episode is over.
        pushed_m: by how much what stands in the way pushes the robot back, in x and y.
        robot_to_origin: whether the robot is to be put back to the origin, heading along +x.

    """

    happening: str = NOTHING
    score: float = 0.0
    ended: bool = False
    robot_to_origin: bool = False
    pushed_m: tuple[float, float] = (0.0, 0.0)


class Episode(Protocol):
    """One run of a task. It is told where the robot is and moves nothing itself."""

    @property
    def ended(self) -> bool:
        """Whether it is over."""
        ...

    def places(self) -> Mapping[int, Pose]:
        """Where the scene's objects stand now, by their index; the others are not there."""
        ...

    def free_way_m(self, robot: Pose) -> float:
        """How far the robot can drive at least, whatever the way, before anything can happen."""
        ...

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """Go on to where the robot is now, at most some centimetres from where it was."""
        ...

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """The task's `facts` at a decision: for critic, guide, infos and films."""
        ...

    def result(self) -> Mapping[str, Any]:
        """The run so far, in JSON's types; it has the task's `counted`, and `score`."""
        ...


class Guide(Protocol):
    """Advises n robots at once what a policy with a memory could do; knows what they are like."""

    def become(self, bodies: NDArray[np.void]) -> None:
        """Say what the robots are like: BODY_RECORD, shape (n,)."""
        ...

    def act(self, facts: NDArray[np.void]) -> NDArray[np.float32]:
        """Both wheels, shape (n, 2), up to 2 where a turn comes on top; NaN without advice."""
        ...

    def forget(self, who: NDArray[np.bool_]) -> None:
        """These, shape (n,), remember nothing from now on."""
        ...

    def drove(self, actions: NDArray[np.float32]) -> None:
        """Say what was done instead, shape (n, 2)."""
        ...

    def shows(self, facts: NDArray[np.void]) -> NDArray[np.bool_]:
        """Whether pictures show what matters, which are then rehearsed by themselves; facts of
        any shape, which is the answer's.
        """
        ...
