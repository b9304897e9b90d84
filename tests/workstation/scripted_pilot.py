"""A pilot that drives as it is told, in a worker's process, and says what it saw there."""

import os
from dataclasses import dataclass, field

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.worlds.segment import Decisions, HiddenState, SegmentPlan


def wheels_as_plan(wheels: np.ndarray) -> SegmentPlan:
    """What a ScriptedPilot is told: wheels, shape (decisions, n, 2)."""
    return SegmentPlan(None, wheels, np.zeros(wheels.shape[:2], np.bool_))


@dataclass
class ScriptedPilot:
    """Drives its plan's noise. Of its decisions, `known` are the pictures that it saw, `forgot`
    whose episodes ended, and `states` the number of its process.
    """

    left: list[np.ndarray] = field(default_factory=list)
    pictures: list[np.ndarray] = field(default_factory=list)
    ended: list[np.ndarray] = field(default_factory=list)

    def start(self, plan: SegmentPlan) -> None:
        self.left, self.pictures, self.ended = list(plan.noise), [], []

    def decide(self, pictures: np.ndarray) -> np.ndarray:
        self.pictures.append(pictures.copy())
        return self.left.pop(0)

    def arrive(self, ended: np.ndarray) -> None:
        self.ended.append(ended.copy())

    def decisions(self) -> Decisions:
        assert not self.left, "not all was driven"
        ended = np.array(self.ended)
        nothing = np.zeros((*ended.shape, 2), np.float32)
        return Decisions(
            states=np.full((*ended.shape, 1), os.getpid()),
            previous_actions=nothing,
            forgot=ended,
            actions=nothing,
            wheels=nothing,
            known=np.array(self.pictures),
            after=HiddenState(nothing[-1], nothing[-1], ended[-1]),
        )


class MistakenPilot(ScriptedPilot):
    """Finds that a person has to mend something."""

    def decide(self, pictures: np.ndarray) -> np.ndarray:
        raise ConfigurationError("the policy was deleted")
