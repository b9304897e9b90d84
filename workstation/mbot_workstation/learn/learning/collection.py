"""Fills PPO's rollouts: each worker's robots are driven by its own copy of the policy.

SB3's own loop decides for all, then waits for all, so that cores wait for each other twice a
decision. Here nobody waits for anybody for a whole stretch of decisions, and what was collected is
written down while the next one is driven. It does not depend on who is faster: a seed gives the
same run.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_workstation.learn.drivers.guide import Guide, shown
from mbot_workstation.learn.learning.memory_policy import (
    ACTIONS,
    Before,
    MemoryPolicy,
    truth,
)
from mbot_workstation.learn.learning.policy_pilot import Notes, PolicyPilot, Task
from mbot_workstation.learn.learning.sequences import SequenceBuffer
from mbot_workstation.learn.worlds.fetch_vec_env import Arrival, FetchVecEnv
from mbot_workstation.learn.worlds.shared_arrays import STRETCH

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
        environment: FetchVecEnv,
        guide_for: Callable[[int], Guide] | None = None,
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
        self.environment.hire(PolicyPilot(policy))
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
        lengths = np.diff([*range(0, size, STRETCH), size]).tolist()
        self._drive(lengths[0], policy)
        for following in (*lengths[1:], 0):
            if following:
                self._drive(following)
            arrival = self.environment.arrive()
            self._write_down(arrival, policy, buffer, reward_scale)
            for infos in arrival.infos:
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
        tasks = [
            Task(weights, noise[:, share.start : share.stop], forgets[:, share.start : share.stop])
            for share in self.environment.shares
        ]
        self.environment.drive(decisions, tasks)

    def _write_down(
        self, arrival: Arrival, policy: MemoryPolicy, buffer: SequenceBuffer, reward_scale: float
    ) -> None:
        """A stretch: what it was about, what was decided, and what is to be said of that."""
        notes = Notes.together(arrival.notes)
        shape = arrival.rewards.shape
        place = slice(buffer.pos, buffer.pos + len(arrival.rewards))
        buffer.observations[place] = arrival.pictures
        buffer.states[place] = notes.states
        buffer.previous_actions[place] = notes.previous_actions
        buffer.forgot[place] = notes.forgot
        buffer.episode_starts[place] = np.concatenate([self._began[None], arrival.ended[:-1]])
        buffer.actions[place] = notes.actions
        buffer.rewards[place] = arrival.rewards * reward_scale
        true = truth(arrival.situations.ravel(), arrival.bodies.ravel())
        buffer.truth[place] = true.reshape(*shape, -1)
        judged = policy.judge(
            *(
                torch.from_numpy(one.reshape(len(true), -1)).to(policy.device)
                for one in (notes.known, notes.actions, true)
            )
        )
        buffer.values[place] = judged.values.cpu().numpy().reshape(shape)
        buffer.log_probs[place] = judged.log_probs.cpu().numpy().reshape(shape)
        if self._guide is not None:
            buffer.advice[place] = self._advice(self._guide, arrival, notes)
            buffer.shows[place] = shown(arrival.situations)
        self._began, self._mind = arrival.ended[-1], notes.after

    def _advice(self, guide: Guide, arrival: Arrival, notes: Notes) -> NDArray[np.float32]:
        """What the guide would have done, decision by decision, shape (decisions, n, 2)."""
        advice = np.empty_like(notes.told)
        for now, situations in enumerate(arrival.situations):
            guide.become(arrival.bodies[now])
            guide.forget(notes.forgot[now])
            advice[now] = guide.act(situations)
            guide.drove(notes.told[now])
        return advice

    def _expected(self, policy: MemoryPolicy) -> torch.Tensor:
        """Values of what the robots see now, shape (n,)."""
        sight, mind, device = self.environment.sight(), self._mind, policy.device
        pictures, state, told = (
            torch.from_numpy(one).to(device) for one in (sight.pictures, mind.state, mind.told)
        )
        after = policy.decide(Before(pictures, state, told))
        seen = torch.from_numpy(truth(sight.situations, sight.bodies))
        return policy.value_of(after.known, seen.to(device)).cpu()
