"""A pilot that drives as it is told, in a worker's process, and says what it saw there."""

import os
from dataclasses import dataclass, field

import numpy as np

from mbot_protocol.errors import ConfigurationError


@dataclass
class ScriptedPilot:
    """Its task are the wheels, shape (decisions, n, 2); its notes see `Seen`."""

    left: list[np.ndarray] = field(default_factory=list)
    pictures: list[np.ndarray] = field(default_factory=list)
    ended: list[np.ndarray] = field(default_factory=list)

    def start(self, task: np.ndarray) -> None:
        self.left, self.pictures, self.ended = list(task), [], []

    def decide(self, pictures: np.ndarray) -> np.ndarray:
        self.pictures.append(pictures.copy())
        return self.left.pop(0)

    def arrive(self, ended: np.ndarray) -> None:
        self.ended.append(ended.copy())

    def notes(self) -> "Seen":
        assert not self.left, "not all was driven"
        return Seen(os.getpid(), np.array(self.pictures), np.array(self.ended))


class MistakenPilot(ScriptedPilot):
    """Finds that a person has to mend something."""

    def decide(self, pictures: np.ndarray) -> np.ndarray:
        raise ConfigurationError("the policy was deleted")


@dataclass(frozen=True)
class Seen:
    process: int
    pictures: np.ndarray
    ended: np.ndarray
