"""PPO as stable-baselines3 has it, set up for the paper's network and pictures."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from stable_baselines3.common.vec_env import VecEnv

from mbot_workstation.learn.learning.memory_policy import (
    MEMORY_UNITS,
    MemoryPolicy,
    critic_inputs,
    memory_policy_arguments,
)
from mbot_workstation.learn.learning.network import INITIAL_NOISE, PAPER_FILTER_PX
from mbot_workstation.learn.learning.picture_ppo import PicturePPO
from mbot_workstation.learn.learning.sequences import SequenceBuffer


@dataclass(frozen=True, slots=True)
class LearnerSettings:
    """Every number of PPO that is ours to choose.

    Attributes:
        steps_per_robot: decisions of every robot between updates; 128 are half an episode of ten
            objects, and 16 robots make 2,048.
        batch: samples of one gradient step.
        epochs: how often a sample is learned from.
        learning_rate, final_learning_rate: at the first and the last planned decision, linear in
            between.
        discount: a decision later is worth so much less. The reward's own price of time is
            small, in the paper 1 / 167 of an object a decision.
        gae_lambda: of the generalised advantage estimate.
        clip_range: how far an update may move an action's probability.
        entropy_weight: keeps a little exploration.
        value_weight: of the value's loss; the network's trunk serves both.
        largest_gradient: the gradient's norm is cut to it.
        reward_scale: rewards are multiplied by it before PPO sees them, which brings values from
            about 10 to about 2. A constant, not running statistics: nothing to save, and the
            same reward is worth the same in every lesson.
        noise, final_noise: of the exploration, in shares of full speed, at the first and the last
            planned decision, geometric in between. Not learned: PPO lowers it wherever noise
            costs reward, and had 0.05 left after 1.5 million decisions, too little to find
            anything out (measured).
        guided_decisions: for how long a guide's advice counts; 0 is PPO alone, as in the paper.
        guided_epochs: in place of `epochs` while the guide's advice counts for more than half,
            which rehearsals teach besides; None is as many.
        rehearsals: batches of remembered advice learned from in every update meanwhile.
        rehearsal_batch: decisions of each.
        memory_units: numbers that the policy remembers from decision to decision; 0 is the
            paper's network.
        first_filter_px: side of the first convolution's filters; the paper's have 8.
        residual: whether it is the residual network in place of the paper's.
        eye_pictures: by which the network learns to see before anybody drives (`eye.py`), and
            then no more; 0 lets it learn to see by driving.

    """

    steps_per_robot: int = 128
    batch: int = 256
    epochs: int = 4
    learning_rate: float = 4e-4
    final_learning_rate: float = 4e-5
    discount: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    entropy_weight: float = 1e-3
    value_weight: float = 0.5
    largest_gradient: float = 0.5
    reward_scale: float = 0.2
    noise: float = INITIAL_NOISE
    final_noise: float = 0.1
    guided_decisions: int = 0
    guided_epochs: int | None = None
    rehearsals: int = 0
    rehearsal_batch: int = 512
    memory_units: int = MEMORY_UNITS
    first_filter_px: int = PAPER_FILTER_PX
    residual: bool = False
    eye_pictures: int = 0

    def learning_rate_at(self, remaining: float) -> float:
        """The learning rate when this share, 1 to 0, of the planned decisions remains."""
        final = self.final_learning_rate
        return final + (self.learning_rate - final) * min(1.0, max(0.0, remaining))

    def noise_at(self, remaining: float) -> float:
        """The exploration noise when this share, 1 to 0, of the planned decisions remains."""
        share = min(1.0, max(0.0, remaining))
        return self.final_noise * (self.noise / self.final_noise) ** share


FINE_TUNING = LearnerSettings(
    steps_per_robot=512,
    batch=1024,
    epochs=5,
    learning_rate=2e-4,
    final_learning_rate=2e-5,
    discount=0.98,
    entropy_weight=0.0,
    noise=0.165,
    final_noise=0.06,
)
"""For a trained policy. What is left to win is less than what luck with objects and robots adds to
an episode: with 2,048 decisions an update and batches of 256 PPO made such a policy worse, with
8,192 and 1,024 better (measured)."""

GUIDED = replace(
    FINE_TUNING,
    learning_rate=5e-4,
    guided_epochs=2,
    rehearsals=128,
    residual=True,
    eye_pictures=800_000,
)
"""The guide soon makes a trained policy of it; its advice is no matter of luck and bears larger
steps, in small batches. Finer filters than the paper's see more of the far objects (network.py).
Five epochs of PPO are a quarter of a rollout's time (7.0 of 27.4 s, measured); what two cost in
quality was never measured by itself: the whole runs with two and with five (docs/notebook)
differ in their lessons and in how often memories are zeroed as well."""


def make_learner(
    environment: VecEnv,
    settings: LearnerSettings,
    seed: int,
    device: str = "cpu",
    critic: Mapping[str, float] = MappingProxyType({}),
    policy: type[MemoryPolicy] = MemoryPolicy,
) -> PicturePPO:
    """An untrained learner; the seed settles its weights and its exploration.

    `critic` is the task's: what its critic is told beside the robot's body.
    """
    learner = PicturePPO(
        policy,
        environment,
        learning_rate=settings.learning_rate_at,
        n_steps=settings.steps_per_robot,
        batch_size=settings.batch,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.gae_lambda,
        clip_range=settings.clip_range,
        ent_coef=settings.entropy_weight,
        vf_coef=settings.value_weight,
        max_grad_norm=settings.largest_gradient,
        policy_kwargs=memory_policy_arguments(
            settings.memory_units,
            math.log(settings.noise),
            critic_inputs(critic),
            settings.first_filter_px,
            residual=settings.residual,
        ),
        rollout_buffer_class=SequenceBuffer,
        seed=seed,
        device=device,
    )
    learner.reward_scale = settings.reward_scale
    learner.noise_at = settings.noise_at
    learner.guided_decisions = settings.guided_decisions
    learner.guided_epochs = settings.guided_epochs
    learner.rehearsals = settings.rehearsals
    learner.rehearsal_batch = settings.rehearsal_batch
    return learner
