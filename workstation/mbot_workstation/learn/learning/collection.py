"""Fills PPO's rollouts: each worker's robots are driven by its own copy of the policy.

SB3's own loop decides for all, then waits for all, so that cores wait for each other twice a
decision. Here nobody waits for anybody for a whole segment of decisions, and what was collected is
written down while the next one is driven. It does not depend on who is faster: a seed gives the
same run.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_workstation.learn.learning.memory_policy import (
    ACTIONS,
    MemoryPolicy,
    PolicyInput,
    truth,
)
from mbot_workstation.learn.learning.policy_pilot import PolicyPilot
from mbot_workstation.learn.learning.sequences import SequenceBuffer
from mbot_workstation.learn.worlds.segment import Decisions, Segment, SegmentPlan
from mbot_workstation.learn.worlds.shared_arrays import SEGMENT
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.tasks.episode import Guide

FORGETS = 1 / 150
"""How often a memory is zeroed in the middle of an episode: a robot zeroes it after a held
decision, and must drive on. What an empty memory makes of a picture is rehearsed besides
(`AdviceMemory.draw_alone`)."""


class Collection:
    """Collects rollouts from the robots of an environment.

    Attributes:
        environment: where they drive.

    """

    def __init__(
        self,
        environment: TaskVecEnv,
        guide_for: Callable[[int], Guide | None] | None = None,
        seed: int = 0,
    ) -> None:
        """Prepare; `begin` before the first rollout.

        Args:
            environment: that PPO learns in.
            guide_for: makes a guide for so many robots, to be asked as well; None without one.
            seed: of when memories are zeroed.

        """
        self.environment = environment
        self._guide_for = guide_for
        self._rng = np.random.default_rng(seed)

    def begin(self, policy: MemoryPolicy) -> None:
        """From here on, in a fresh environment or a running one; nobody remembers anything."""
        robots = self.environment.num_envs
        self.environment.halt()
        self.environment.set_pilot(PolicyPilot(policy))
        self._guide = self._guide_for(robots) if self._guide_for else None
        self._began = np.ones(robots, np.bool_)

    @torch.no_grad()
    def fill(
        self,
        buffer: SequenceBuffer,
        policy: MemoryPolicy,
        reward_scale: float,
        go_on: Callable[[list[dict[str, Any]]], bool],
    ) -> bool:
        """A rollout, with its returns and advantages.

        Args:
            buffer: to be filled from its beginning.
            policy: decides.
            reward_scale: rewards are multiplied by it.
            go_on: asked after every decision of all robots, with the infos of those whose episodes
                ended in it. Robots may be driving the next ones already, in which a lesson that
                it gives does not count yet.

        Returns:
            Whether it is whole; False if it was not to go on.

        """
        buffer.reset()
        size = buffer.buffer_size
        lengths = np.diff([*range(0, size, SEGMENT), size]).tolist()
        self._drive(lengths[0], policy)
        for following in (*lengths[1:], 0):
            if following:
                self._drive(following)
            segment = self.environment.arrive()
            self._write_down(segment, policy, buffer, reward_scale)
            for infos in segment.infos:
                buffer.pos += 1
                buffer.full = buffer.pos == size
                if not go_on(infos):
                    return False
        buffer.compute_returns_and_advantage(self._expected(policy), self._began)
        return True

    def _drive(self, decisions: int, learned: MemoryPolicy | None = None) -> None:
        """Send all robots on their way, by what was learned meanwhile if anything was."""
        shape = (decisions, self.environment.num_envs)
        weights = None
        if learned is not None:
            weights = {name: one.cpu().numpy() for name, one in learned.state_dict().items()}
        noise = torch.randn(*shape, ACTIONS).numpy()
        forgets = self._rng.random(shape) < FORGETS
        plans = [
            SegmentPlan(
                weights, noise[:, share.start : share.stop], forgets[:, share.start : share.stop]
            )
            for share in self.environment.shares
        ]
        self.environment.drive(decisions, plans)

    def _write_down(
        self, segment: Segment, policy: MemoryPolicy, buffer: SequenceBuffer, reward_scale: float
    ) -> None:
        """A segment: what it was about, what was decided, and what is to be said of that."""
        made = segment.decisions
        shape = segment.rewards.shape
        place = slice(buffer.pos, buffer.pos + len(segment.rewards))
        if buffer.features:
            buffer.observations[place] = made.known[..., : buffer.features]
        else:
            buffer.observations[place] = segment.pictures
        buffer.states[place] = made.states
        buffer.previous_actions[place] = made.previous_actions
        buffer.forgot[place] = made.forgot
        buffer.episode_starts[place] = np.concatenate([self._began[None], segment.ended[:-1]])
        buffer.actions[place] = made.actions
        buffer.rewards[place] = segment.rewards * reward_scale
        true = truth(
            self.environment.task.critic, segment.situations.ravel(), segment.bodies.ravel()
        )
        buffer.truth[place] = true.reshape(*shape, -1)
        judged = policy.judge(
            *(
                torch.from_numpy(one.reshape(len(true), -1)).to(policy.device)
                for one in (made.known, made.actions, true)
            )
        )
        buffer.values[place] = judged.values.cpu().numpy().reshape(shape)
        buffer.log_probs[place] = judged.log_probs.cpu().numpy().reshape(shape)
        if self._guide is not None:
            buffer.advice[place] = self._advice(self._guide, segment, made)
            buffer.shows[place] = self._guide.shows(segment.situations)
        self._began, self._hidden = segment.ended[-1], made.after

    def _advice(self, guide: Guide, segment: Segment, made: Decisions) -> NDArray[np.float32]:
        """What the guide would have done, decision by decision, shape (decisions, n, 2)."""
        advice = np.empty_like(made.wheels)
        for now, situations in enumerate(segment.situations):
            guide.become(segment.bodies[now])
            guide.forget(made.forgot[now])
            advice[now] = guide.act(situations)
            guide.drove(made.wheels[now])
        return advice

    def _expected(self, policy: MemoryPolicy) -> torch.Tensor:
        """Values of what the robots see now, shape (n,)."""
        seen, hidden, device = self.environment.observations(), self._hidden, policy.device
        inputs = PolicyInput(
            *(
                torch.from_numpy(one).to(device)
                for one in (seen.pictures, hidden.state, hidden.previous_actions)
            )
        )
        known = policy.decide(inputs).known
        true = truth(self.environment.task.critic, seen.situations, seen.bodies)
        return policy.value_of(known, torch.from_numpy(true).to(device)).cpu()
