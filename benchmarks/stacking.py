"""What a learned memory is worth against stacking: a policy that is shown its last four decisions.

    python benchmarks/stacking.py runs/first --decisions 450560

Trained as that run was, by its configuration and schedule, until so many decisions; but where the
run's policy has a GRU, this one has what the network makes of the last four pictures and the
actions before them, and a dense layer of as many units over that. To be compared with the run's
checkpoint of as many decisions, `workstation export runs/first/checkpoints/000450560`.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from torch import nn

from mbot_workstation.learn.drivers.contestants import Driver
from mbot_workstation.learn.drivers.onnx_policy import Actions, Pictures
from mbot_workstation.learn.evaluation.episodes import Trial, evaluate_driver, robots_of, score
from mbot_workstation.learn.evaluation.provenance import provenance
from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.learner import make_learner
from mbot_workstation.learn.learning.memory_policy import ACTIONS, Before, MemoryPolicy
from mbot_workstation.learn.learning.network import DENSE_UNITS
from mbot_workstation.learn.learning.processor import keep_freed_memory
from mbot_workstation.learn.learning.training_config import read_config
from mbot_workstation.learn.learning.training_run import environment_of, guides_of
from mbot_workstation.learn.worlds.lessons import lesson
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.sim.effects.presets import preset

WINDOW = 4
"""Decisions, 1.6 s; four pictures are what is usual since the Atari games."""

DECISION = DENSE_UNITS + ACTIONS
PRESETS = ("nominal", "handicap", "late", "any-room", "randomised")


class StackingPolicy(MemoryPolicy):
    """Remembers the last decisions as they were, and nothing else."""

    stacked: nn.Linear

    @property
    def units(self) -> int:
        """Numbers a robot remembers: features and the action before them, newest first."""
        return WINDOW * DECISION

    def _recall_all(
        self, met: torch.Tensor, forgot: torch.Tensor, state: torch.Tensor
    ) -> torch.Tensor:
        states: list[torch.Tensor] = []
        for decision, begins in zip(met, forgot, strict=True):
            state = _shifted(state * (1.0 - begins).unsqueeze(1), decision)
            states.append(state)
        return torch.tanh(self.stacked(torch.cat(states)))

    def _recall(self, before: Before) -> tuple[torch.Tensor, torch.Tensor]:
        features = self._features(before.pictures)
        state = _shifted(before.state, torch.cat([features, before.previous_actions], dim=1))
        return torch.cat([features, torch.tanh(self.stacked(state))], dim=1), state

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.memory = None
        self.stacked = nn.Linear(self.units, self._units)
        self.optimizer = self.optimizer_class(
            self.parameters(), **{"lr": lr_schedule(1), **self.optimizer_kwargs}
        )


def _shifted(state: torch.Tensor, decision: torch.Tensor) -> torch.Tensor:
    return torch.cat([decision, state[:, :-DECISION]], dim=1)


class StopAt(BaseCallback):
    """Ends the training after so many decisions of its schedule."""

    def __init__(self, decisions: int) -> None:
        super().__init__()
        self._decisions = decisions

    def _on_step(self) -> bool:
        if self.num_timesteps % 8192 == 0:
            print(f"{self.num_timesteps} decisions", flush=True)
        return self.num_timesteps < self._decisions


def trained(run: Path, decisions: int) -> StackingPolicy:
    """By a run's configuration."""
    keep_freed_memory()
    torch.set_num_threads(1)
    config = read_config(run / "config.json")
    with environment_of(config) as environment:
        learner = make_learner(environment, config.learner, config.seed, policy=StackingPolicy)
        learner.collection = Collection(environment, guides_of(config), config.seed)
        learner.learn(config.steps, callback=StopAt(decisions))
    policy = learner.policy
    assert isinstance(policy, StackingPolicy)
    return policy


class Stacking:
    """Drives a number of robots."""

    def __init__(self, policy: StackingPolicy, robots: int) -> None:
        self._policy = policy
        self._state = torch.zeros(robots, policy.units)
        self._told = torch.zeros(robots, ACTIONS)

    @torch.no_grad()
    def act(self, pictures: Pictures, _: NDArray[np.float64]) -> Actions:
        """Both wheels of every robot."""
        before = Before(torch.from_numpy(pictures), self._state, self._told)
        decided = self._policy.decide(before)
        self._state, self._told = decided.state, within_full_speed(decided.actions)
        return self._told.numpy()

    def forget(self, robots: NDArray[np.bool_]) -> None:
        """Begin anew for these."""
        which = torch.from_numpy(robots)
        self._state[which] = 0
        self._told[which] = 0


def main() -> None:
    """Train, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="folder of a run of `workstation train`")
    parser.add_argument("--decisions", type=int, default=450_560)
    parser.add_argument("--episodes", type=int, default=100)
    options = parser.parse_args()
    policy = trained(options.run, options.decisions)
    rooms = evaluation_rooms([])
    print(f"{provenance([])} {options.episodes} episodes, mean reward of 21, all ten touched.\n")
    print("| preset | last four decisions | |\n|---|---|---|")
    for name in PRESETS:
        trial = Trial(lesson("10"), preset(name), rooms, options.episodes)
        driven = Stacking(policy, robots_of(trial))
        found = score(evaluate_driver(Driver(driven.act, driven.forget), trial))
        reward = found.reward
        interval = f"{reward.mean:.2f} ({reward.low:.2f} to {reward.high:.2f})"
        print(f"| {name} | {interval} | {found.success.mean:.0%} |", flush=True)


if __name__ == "__main__":
    main()
