"""What a network learns before anybody drives: to say what pictures show.

Of every picture of a simulation it is known whether it shows the object, and where. To be told that
directly, by pictures from anywhere, teaches more a minute than to be told how to drive: a picture
costs 0.7 ms and needs no physics, no memory and no critic. What is learned here are the layers in
front of the memory, and a last one that says what they see and what the guide would do: with its
advice the policy begins. Then the eye learns no more, and a picture is 256 numbers to whoever
learns to drive: that costs a fiftieth of learning through all layers.
"""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from mbot_workstation.learn.learning.guidance import advice_loss
from mbot_workstation.learn.learning.memory_policy import ACTIONS
from mbot_workstation.learn.learning.network import DENSE_UNITS
from mbot_workstation.learn.learning.processor import has_short_floats
from mbot_workstation.learn.learning.views import Stills, Views, seen_by, take_views
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.tasks.episode import Guide

ROUND = 32_000
"""Pictures that are kept at a time: 400 MB, twice that while they are put together."""

EPOCHS = 1
"""How often each is learned from before it is forgotten. After twelve times the network knew them
by heart; twice as many pictures once each, in place of half of them twice, changed little
(docs/notebook/training.md)."""

STILLS = 48_000
"""Views that an eye is shown when it has learned, at most; 48 MB as it sees them."""

BATCH = 256
THREADS = 2
LEARNING_RATE, FINAL_LEARNING_RATE = 1e-3, 5e-5
NUMBERS_COUNT = 3.0
"""Of where it is, against whether it is there."""


def teach_eye(
    network: nn.Module,
    environment: TaskVecEnv,
    guide_for: Callable[[int], Guide | None] | None,
    pictures: int,
    stop: threading.Event,
    say: Callable[[str], None],
) -> nn.Linear | None:
    """Let a network learn what the task's pictures show, and what a guide would do there.

    Args:
        network: pictures, shape (n, 64, 64, 3), float, to features, shape (n, 256).
        environment: where they are taken; `reset` it afterwards.
        guide_for: makes a guide for so many robots; None without one.
        pictures: how many.
        stop: set it to end early.
        say: told how far it is.

    Returns:
        The layer from features to the guide's advice; None if the task says nothing of its
        pictures, or someone said stop.

    """
    if environment.task.sight is None:
        return None
    device = next(network.parameters()).device
    heads: nn.Linear | None = None
    optimiser: torch.optim.Optimizer | None = None
    rounds = max(1, round(pictures / ROUND))
    with ThreadPoolExecutor(1 if device.type != "cpu" else THREADS) as threads:
        for number in range(rounds):
            views = take_views(environment, guide_for, pictures // rounds, stop)
            if heads is None or optimiser is None:
                told = views.sights.shape[1] + views.advice.shape[1]
                heads = nn.Linear(DENSE_UNITS, told).to(device)
                learned = [*network.parameters(), *heads.parameters()]
                optimiser = torch.optim.AdamW(learned, lr=LEARNING_RATE, weight_decay=1e-4)
            begun, ends = number / rounds, (number + 1) / rounds
            learner = _Learner(network, heads, optimiser, threads)
            mean_loss = learner.learn(views, (begun, ends), stop)
            if stop.is_set():
                return None
            say(
                f"seeing: {(number + 1) * len(views):,} of {rounds * len(views):,} pictures, "
                f"loss {mean_loss:.3f}"
            )
    assert heads is not None
    return _last_outputs(heads, ACTIONS)


def take_stills(
    network: nn.Module,
    environment: TaskVecEnv,
    guide_for: Callable[[int], Guide | None] | None,
    learned_from: int,
    units: int,
    stop: threading.Event,
) -> Stills:
    """What an eye that has learned from so many pictures sees in other ones, no more than these;
    `reset` the environment afterwards.
    """
    views = take_views(environment, guide_for, min(STILLS, learned_from), stop)
    with ThreadPoolExecutor(THREADS) as threads:
        return seen_by(network, views, units, threads)


def _last_outputs(layer: nn.Linear, count: int) -> nn.Linear:
    """A layer that makes the last so many of another's outputs."""
    last = nn.Linear(layer.in_features, count, device=layer.weight.device)
    with torch.no_grad():
        last.weight.copy_(layer.weight[-count:])
        last.bias.copy_(layer.bias[-count:])
    return last


@dataclass(frozen=True, slots=True)
class _Learner:
    """Threads that each learn from a part of every batch, on a core: see picture_ppo.py."""

    network: nn.Module
    heads: nn.Linear
    optimiser: torch.optim.Optimizer
    threads: ThreadPoolExecutor

    def learn(
        self,
        views: Views,
        shares: tuple[float, float],
        stop: threading.Event,
    ) -> float:
        """A few epochs of a round, which lies between these shares of the whole; the mean loss."""
        batches, total = _batches(len(views)), 0.0
        for step, drawn in enumerate(batches):
            if stop.is_set():
                break
            share = shares[0] + (shares[1] - shares[0]) * step / len(batches)
            for group in self.optimiser.param_groups:
                group["lr"] = LEARNING_RATE * (FINAL_LEARNING_RATE / LEARNING_RATE) ** share
            parts = np.array_split(drawn, THREADS)
            done = list(self.threads.map(lambda part: self._gradients(views, part), parts))
            for parameter, *gradients in zip(
                self._learned, *(part for part, _ in done), strict=True
            ):
                total_gradient = torch.stack(gradients).sum(dim=0) / len(drawn)
                parameter.grad = torch.empty_like(parameter).copy_(total_gradient)
            self.optimiser.step()
            total += sum(loss for _, loss in done) / len(drawn)
        return total / len(batches)

    @property
    def _learned(self) -> list[nn.Parameter]:
        return [*self.network.parameters(), *self.heads.parameters()]

    def _gradients(
        self, views: Views, drawn: NDArray[np.int64]
    ) -> tuple[tuple[torch.Tensor, ...], float]:
        """Of the loss, summed over these of the views; and the loss."""
        device = self.heads.weight.device
        short = has_short_floats(device)
        batch, truth, advice = (
            torch.from_numpy(one[drawn]).to(device)
            for one in (views.pictures, views.sights, views.advice)
        )
        with torch.autocast(device.type, torch.bfloat16, enabled=short):
            features = self.network(batch.to(torch.bfloat16 if short else torch.float32))
        said = self.heads(features.float())
        shown, wheels = said[:, : truth.shape[1]], said[:, truth.shape[1] :]
        loss = _loss(shown, torch.nan_to_num(truth)) + advice_loss(wheels, advice)
        return torch.autograd.grad(loss, self._learned), float(loss.detach())


def _batches(views: int) -> list[NDArray[np.int64]]:
    """Numbers of views, each as often as it is learned from, in any order."""
    drawn = np.concatenate([np.random.permutation(views) for _ in range(EPOCHS)])
    return np.array_split(drawn, max(1, len(drawn) // BATCH))


def _loss(told: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Summed over pictures."""
    shown = truth[:, 0]
    there = functional.binary_cross_entropy_with_logits(told[:, 0], shown, reduction="sum")
    apart = (told[:, 1:] - truth[:, 1:]).square().mean(dim=1)
    return there + NUMBERS_COUNT * (shown * apart).sum()
