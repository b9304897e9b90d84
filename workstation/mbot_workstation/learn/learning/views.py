"""Single pictures from anywhere, what they show, and what the guide would do there.

In a simulation these labels are free. What robots that drive together see is much of a kind, a
hundred pictures of a room in a row; these are each from another place, every other one mirrored:
who searches turns right, so that what it drives past shows the object on one side more often.
"""

import threading
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from mbot_workstation.learn.learning.sequences import Sequences
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.tasks.episode import Guide

AT_A_TIME = 512
"""Pictures whose features are computed together."""


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """Pictures and what is known of them.

    Attributes:
        pictures: shape (n, 64, 64, 3).
        sights: what they show, as the task's `Sight` says it, shape (n, 1 + k).
        advice: the guide's to who remembers nothing, shape (n, 2); NaN where there is none.

    """

    pictures: NDArray[np.uint8]
    sights: NDArray[np.float32]
    advice: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.pictures)


@dataclass(frozen=True, slots=True, eq=False)
class Stills:
    """Views as an eye that learns no more sees them, to be rehearsed: who has just forgotten
    everything goes by one picture.

    Attributes:
        features: shape (n, features).
        advice: shape (n, 2).
        units: of the memory that is empty before them.

    """

    features: NDArray[np.float32]
    advice: NDArray[np.float32]
    units: int

    def draw(self, decisions: int) -> Sequences:
        """Random ones, each a sequence of length 1; numpy's global generator draws."""
        drawn = np.random.randint(len(self.features), size=decisions)
        return Sequences(
            seen=self.features[drawn][None],
            previous_actions=np.zeros((1, decisions, 2), np.float32),
            forgot=np.ones((1, decisions), np.float32),
            state=np.zeros((decisions, self.units), np.float32),
            advice=self.advice[drawn][None],
            shows=np.ones((1, decisions), np.bool_),
        )


def take_views(
    environment: TaskVecEnv,
    guide_for: Callable[[int], Guide | None] | None,
    pictures: int,
    stop: threading.Event,
) -> Views:
    """Take pictures; `reset` the environment before anybody drives.

    Args:
        environment: its task has a `sight`.
        guide_for: makes a guide for so many robots; None without one.
        pictures: about how many; fewer if someone says stop.
        stop: set it to end early.

    """
    sight = environment.task.sight
    assert sight is not None
    taken: list[Views] = []
    for seen, facts in environment.survey(pictures):
        sights = sight.shown(facts)
        advice = np.full((len(seen), 2), np.nan, np.float32)
        tells_side = sights[:, 0] > 0
        if guide_for is not None and (guide := guide_for(len(seen))) is not None:
            advice, tells_side = guide.act(facts), guide.shows(facts)
        turned = np.random.random(len(seen)) < 0.5
        seen[turned] = seen[turned, :, ::-1]
        sights[turned] = sight.mirrored(sights[turned])
        # A search turns right, whatever the picture looks like mirrored.
        advice[turned & tells_side] = advice[turned & tells_side, ::-1]
        taken.append(Views(seen, sights, advice.astype(np.float32)))
        if stop.is_set():
            break
    return Views(
        *(
            np.concatenate([getattr(one, name) for one in taken])
            for name in ("pictures", "sights", "advice")
        )
    )


def seen_by(network: nn.Module, views: Views, units: int, threads: Executor) -> Stills:
    """What an eye makes of views."""
    device = next(network.parameters()).device

    @torch.no_grad()  # of each thread
    def features(part: NDArray[np.uint8]) -> NDArray[np.float32]:
        return network(torch.from_numpy(part).to(device).float()).cpu().numpy()

    parts = [views.pictures[start : start + AT_A_TIME] for start in range(0, len(views), AT_A_TIME)]
    return Stills(np.concatenate(list(threads.map(features, parts))), views.advice, units)
