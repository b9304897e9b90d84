"""Learning from the guide for a while: what it would have done, beside what was tried.

PPO tries the student's own actions, so the guide is asked about the student's situations, not its
own; its weight falls to nothing, and from there on PPO alone improves on it.
"""

from collections.abc import Generator
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback

from mbot_workstation.training.drivers.guide import Guide
from mbot_workstation.training.worlds.fetch_vec_env import FetchVecEnv


class GuidedSamples(NamedTuple):
    """SB3's samples and what the guide would have done, shape (n, 2); NaN where it can't say."""

    observations: torch.Tensor
    actions: torch.Tensor
    old_values: torch.Tensor
    old_log_prob: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor
    advice: torch.Tensor


class GuidedRolloutBuffer(RolloutBuffer):
    """SB3's rollout buffer with the guide's advice.

    Attributes:
        advice: shape (steps, robots, 2), float32.

    """

    def reset(self) -> None:
        """Empty it."""
        super().reset()
        self.advice = np.full((self.buffer_size, self.n_envs, 2), np.nan, np.float32)

    def get(self, batch_size: int | None = None) -> Generator[Any, None, None]:
        """Shuffled batches of `GuidedSamples`."""
        if not self.generator_ready:
            self._flat_advice = self.swap_and_flatten(self.advice)
        yield from super().get(batch_size)

    def flat_advice(self) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """All observations, shape (n, 64, 64, 3), and their advice, shape (n, 2), in one order.

        Once `get` has been used.
        """
        return self.observations, self._flat_advice

    def _get_samples(self, batch_inds: NDArray[np.int64], env: Any = None) -> Any:
        samples = super()._get_samples(batch_inds, env)
        return GuidedSamples(*samples, advice=self.to_torch(self._flat_advice[batch_inds]))


def advice_loss(wheels: torch.Tensor, advice: torch.Tensor) -> torch.Tensor:
    """Sum over samples of the squared distance to the advice, where there is any. Shape ()."""
    known = torch.isfinite(advice).all(dim=1, keepdim=True)
    return torch.where(known, wheels - torch.nan_to_num(advice), 0.0).square().sum()


def guide_weight(decisions: int, guided_decisions: int) -> float:
    """The advice's weight in the loss: 1 at the first decision, linearly to 0."""
    if guided_decisions <= 0:
        return 0.0
    return max(0.0, 1.0 - decisions / guided_decisions)


class AskTheGuide(BaseCallback):
    """Notes the guide's advice for every decision of a rollout."""

    model: Any

    def __init__(self, guide: Guide, environment: FetchVecEnv) -> None:
        super().__init__()
        self._guide = guide
        self._environment = environment

    def _on_training_start(self) -> None:
        self._advice = self._guide.act(*_targets(self._environment.reset_infos))

    def _on_step(self) -> bool:
        buffer: GuidedRolloutBuffer = self.model.rollout_buffer
        buffer.advice[buffer.pos] = self._advice
        self._guide.drove(self.locals["clipped_actions"])
        infos = [
            began if done else info
            for began, done, info in zip(
                self._environment.reset_infos,
                self.locals["dones"],
                self.locals["infos"],
                strict=True,
            )
        ]
        self._advice = self._guide.act(*_targets(infos))
        return True


def _targets(infos: list[dict[str, Any]]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the objects are, shape (robots, 2), and where they were seen, shape (robots,)."""
    nowhere = float("nan")
    names = ("target_ahead_m", "target_left_m", "seen_left_rad")
    table = np.array([[info.get(name, nowhere) for name in names] for info in infos])
    return table[:, :2], table[:, 2]
