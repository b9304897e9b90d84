"""What stands beside SB3's rollouts: memory goes from decision to decision, the guide is asked."""

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback

from mbot_workstation.training.drivers.guide import Guide
from mbot_workstation.training.learning.memory_policy import MemoryPolicy, truth
from mbot_workstation.training.learning.sequences import SequenceBuffer
from mbot_workstation.training.worlds.fetch_vec_env import FetchVecEnv

FORGETS = 1 / 400
"""How often a memory is zeroed in the middle of an episode: a robot zeroes it after a held
decision, and must drive on."""


class Remembering(BaseCallback):
    """Carries the policy's memory from decision to decision and notes it for the update.

    Args:
        environment: that SB3 steps, maybe inside wrappers.
        guide: to be asked as well; None without one.
        seed: of when memories are zeroed.

    """

    model: Any

    def __init__(self, environment: FetchVecEnv, guide: Guide | None, seed: int) -> None:
        super().__init__()
        self._environment = environment
        self._guide = guide
        self._rng = np.random.default_rng(seed)

    def _on_training_start(self) -> None:
        robots = self._environment.num_envs
        self._policy.begin(robots)
        self._forgot = np.ones(robots, np.bool_)
        self._look()

    def _on_step(self) -> bool:
        buffer: SequenceBuffer = self.model.rollout_buffer
        policy, place = self._policy, buffer.pos
        buffer.states[place] = policy.state.cpu().numpy()
        buffer.previous_actions[place] = policy.previous_action.cpu().numpy()
        buffer.truth[place] = policy.truth.cpu().numpy()
        buffer.forgot[place] = self._forgot
        actions = self.locals["clipped_actions"]
        if self._guide is not None:
            buffer.advice[place] = self._advice
            self._guide.drove(actions)
        ended = self.locals["dones"]
        self._forgot = ended | (self._rng.random(len(ended)) < FORGETS)
        policy.drove(actions, self._forgot)
        self._look()
        return True

    @property
    def _policy(self) -> MemoryPolicy:
        return self.model.policy

    def _look(self) -> None:
        """What is true at the moment that the newest observations show."""
        situations, bodies = self._environment.situations, self._environment.bodies
        self._policy.truth = torch.from_numpy(truth(situations, bodies)).to(self._policy.device)
        if self._guide is not None:
            self._guide.become(bodies)
            self._advice = self._guide.act(situations)
