"""Fills PPO's rollouts: half of the robots drive while the policy decides for the other half.

SB3's own loop decides for all, then waits for all, so that cores wait for each other twice a
decision. What is collected does not depend on who is faster: a seed gives the same run.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_workstation.training.drivers.guide import Guide, shown
from mbot_workstation.training.learning.full_speed import within_full_speed
from mbot_workstation.training.learning.memory_policy import (
    ACTIONS,
    Before,
    MemoryPolicy,
    truth,
)
from mbot_workstation.training.learning.sequences import SequenceBuffer
from mbot_workstation.training.worlds.fetch_vec_env import FetchVecEnv, Sight

FORGETS = 1 / 150
"""How often a memory is zeroed in the middle of an episode: a robot zeroes it after a held
decision, and must drive on. What an empty memory makes of a picture is rehearsed besides
(`AdviceMemory.draw_alone`)."""


@dataclass(slots=True, eq=False)
class _Half:
    """Robots that are decided for together, n of them.

    Attributes:
        index: which half.
        rows: of the environment.
        guide: asked beside the policy, if there is one.
        sight: what they see now.
        began: whether an episode began before this decision, shape (n,).
        forgot: whether the memory did, shape (n,).
        state: what each remembers, shape (n, units).
        told: what the wheels were told in the last decision, shape (n, 2).

    """

    index: int
    rows: NDArray[np.intp]
    guide: Guide | None
    sight: Sight
    began: NDArray[np.bool_]
    forgot: NDArray[np.bool_]
    state: torch.Tensor
    told: torch.Tensor


@dataclass(frozen=True, slots=True, eq=False)
class _Witness:
    """What is only needed when a rollout is whole; shapes (steps, robots, ...).

    Attributes:
        known: what the policy knew.
        situations, bodies: STEP_RECORD, BODY_RECORD.

    """

    known: torch.Tensor
    situations: NDArray[np.void]
    bodies: NDArray[np.void]


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
        self.environment.receive_all()
        self._halves = [
            _Half(
                index=index,
                rows=rows,
                guide=self._guide_for(len(rows)) if self._guide_for else None,
                sight=self.environment.sight(rows),
                began=np.ones(len(rows), np.bool_),
                forgot=np.ones(len(rows), np.bool_),
                state=torch.zeros(len(rows), policy.units, device=policy.device),
                told=torch.zeros(len(rows), ACTIONS, device=policy.device),
            )
            for index, rows in enumerate(self.environment.halves)
        ]

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
                ended in it.

        Returns:
            Whether it is whole; False if it was not to go on.

        """
        buffer.reset()
        shape = (buffer.buffer_size, buffer.n_envs)
        sight = self._halves[0].sight
        witness = _Witness(
            torch.zeros(*shape, policy.action_net.in_features, device=policy.device),
            np.zeros(shape, sight.situations.dtype),
            np.zeros(shape, sight.bodies.dtype),
        )
        for half in self._halves:
            self._decide(half, policy, buffer, witness)
        while not buffer.full:
            infos: list[dict[str, Any]] = []
            buffer.pos += 1
            buffer.full = buffer.pos == buffer.buffer_size
            for half in self._halves:
                infos += self._arrive(half, buffer, reward_scale)
                if not buffer.full:
                    self._decide(half, policy, buffer, witness)
            if not go_on(infos):
                return False
        self._judge(policy, buffer, witness)
        return True

    def _judge(self, policy: MemoryPolicy, buffer: SequenceBuffer, witness: _Witness) -> None:
        """All that was decided, at once: one by one it would keep the robots waiting."""
        known = truth(witness.situations.ravel(), witness.bodies.ravel())
        buffer.truth[:] = known.reshape(buffer.truth.shape)
        judged = policy.judge(
            witness.known.flatten(0, 1),
            torch.from_numpy(buffer.actions).to(policy.device).flatten(0, 1),
            torch.from_numpy(known).to(policy.device),
        )
        buffer.values[:] = judged.values.cpu().numpy().reshape(buffer.values.shape)
        buffer.log_probs[:] = judged.log_probs.cpu().numpy().reshape(buffer.log_probs.shape)
        values, ended = np.zeros(buffer.n_envs, np.float32), np.zeros(buffer.n_envs, np.bool_)
        for half in self._halves:
            after = policy.decide(_before(half, policy), deterministic=True)
            seen = torch.from_numpy(truth(half.sight.situations, half.sight.bodies))
            expected = policy.value_of(after.known, seen.to(policy.device))
            values[half.rows] = expected.cpu().numpy()
            ended[half.rows] = half.began
        buffer.compute_returns_and_advantage(torch.from_numpy(values), ended)

    def _decide(
        self, half: _Half, policy: MemoryPolicy, buffer: SequenceBuffer, witness: _Witness
    ) -> None:
        """Send a half on its way, and write down what it went by."""
        decided = policy.decide(_before(half, policy))
        actions = decided.actions.cpu().numpy()
        told = within_full_speed(decided.actions).cpu().numpy()
        self.environment.send(half.index, told)
        # From here on the workers have something to do.
        place = buffer.pos, half.rows
        buffer.observations[place] = half.sight.pictures
        buffer.states[place] = half.state.cpu().numpy()
        buffer.previous_actions[place] = half.told.cpu().numpy()
        buffer.forgot[place] = half.forgot
        buffer.episode_starts[place] = half.began
        buffer.actions[place] = actions
        witness.known[place] = decided.known
        witness.situations[place] = half.sight.situations
        witness.bodies[place] = half.sight.bodies
        if half.guide is not None:
            half.guide.become(half.sight.bodies)
            half.guide.forget(half.forgot)
            buffer.advice[place] = half.guide.act(half.sight.situations)
            buffer.shows[place] = shown(half.sight.situations)
            half.guide.drove(told)
        half.state, half.told = decided.state, torch.from_numpy(told).to(policy.device)

    def _arrive(
        self, half: _Half, buffer: SequenceBuffer, reward_scale: float
    ) -> list[dict[str, Any]]:
        """Wait for a half, and see what it sees."""
        arrival = self.environment.receive(half.index)
        buffer.rewards[buffer.pos - 1, half.rows] = arrival.rewards * reward_scale
        half.sight = self.environment.sight(half.rows)
        half.began = arrival.ended
        half.forgot = arrival.ended | (self._rng.random(len(half.rows)) < FORGETS)
        keep = torch.from_numpy(~half.forgot).to(half.state).unsqueeze(1)
        half.state, half.told = half.state * keep, half.told * keep
        return arrival.infos


def _before(half: _Half, policy: MemoryPolicy) -> Before:
    return Before(
        pictures=torch.from_numpy(half.sight.pictures).to(policy.device),
        state=half.state,
        previous_actions=half.told,
    )
