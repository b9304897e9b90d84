"""How fast the whole training loop is, beside stable-baselines3 as its documentation has it.

    python benchmarks/training.py [--json]

Whole loop: collect with 16 robots, then PPO's update, with the paper's network (no memory), the
same batch and epochs on both sides. Plain is `PPO` with `SubprocVecEnv` and `mujoco.Renderer` at
the same picture settings (benchmarks/training_environment.py measures the environments alone). The
bare kernels are physics, picture, forward pass and update without anything around them, on all
cores at once, as they run in a training. All take turns, and ratios are of the same round.
"""

import argparse
import json
import os
import resource
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import SubprocVecEnv
from torch import nn
from torch.distributions import Normal
from training_environment import PlainEnv, kernels

from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.learner import LearnerSettings, make_learner
from mbot_workstation.learn.learning.memory_policy import (
    MemoryPolicy,
    PolicyInput,
    critic_inputs,
    memory_policy_arguments,
)
from mbot_workstation.learn.learning.picture_ppo import PicturePPO
from mbot_workstation.learn.learning.processor import has_short_floats, keep_freed_memory
from mbot_workstation.learn.worlds.task_env import action_space, observation_space
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.tasks.fetch.task import TASK

ROBOTS = 16
SETTINGS = LearnerSettings(memory_units=0)
PRESETS = ("ideal", "nominal", "randomised")


class PlainNetwork(BaseFeaturesExtractor):
    """The paper's network as SB3's documentation writes one."""

    def __init__(self, observation_space: Any) -> None:
        super().__init__(observation_space, 256)
        self.layers = nn.Sequential(
            nn.Conv2d(3, 16, 8, 4),
            nn.LeakyReLU(),
            nn.Conv2d(16, 32, 4, 2),
            nn.LeakyReLU(),
            nn.Flatten(),
            nn.Linear(32 * 6 * 6, 256),
            nn.LeakyReLU(),
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return self.layers(observations)


def plain_learner(room: Any) -> PPO:
    environment = SubprocVecEnv([lambda: PlainEnv(room) for _ in range(ROBOTS)])
    return PPO(
        "CnnPolicy",
        environment,
        n_steps=SETTINGS.steps_per_robot,
        batch_size=SETTINGS.batch,
        n_epochs=SETTINGS.epochs,
        policy_kwargs={"features_extractor_class": PlainNetwork, "net_arch": []},
        device="cpu",
    )


def our_learner(preset: str, rooms: list[Any]) -> PicturePPO:
    environment = TaskVecEnv(ROBOTS, 0, preset, "10", rooms)
    learner = make_learner(environment, SETTINGS, seed=0)
    learner.collection = Collection(environment)
    return learner


TRUTH = critic_inputs(TASK.critic)


def speed(learner: PPO, iterations: int, *, threads: int) -> float:
    """Decisions a second over some rounds of collecting and learning."""
    torch.set_num_threads(threads)
    decisions = iterations * SETTINGS.steps_per_robot * ROBOTS
    start_s = time.perf_counter()
    learner.learn(decisions, reset_num_timesteps=False)
    return decisions / (time.perf_counter() - start_s)


def network_ms() -> dict[str, float]:
    """Milliseconds a decision takes one core: forward pass while collecting, update afterwards."""
    torch.set_num_threads(1)
    rounds = 200
    arguments = memory_policy_arguments(SETTINGS.memory_units, 0.0, TRUTH)
    policy = MemoryPolicy(observation_space(), action_space(), lambda _: 1e-4, **arguments)
    before = PolicyInput(
        pictures=torch.randint(0, 255, (ROBOTS, 64, 64, 3)).to(torch.uint8),
        state=torch.zeros(ROBOTS, policy.units),
        previous_actions=torch.zeros(ROBOTS, 2),
    )
    noise = torch.randn(ROBOTS, 2)
    with torch.no_grad():
        start_s = time.perf_counter()
        known = torch.cat([policy.decide(before, noise).known for _ in range(rounds)])
        policy.judge(known, torch.zeros(len(known), 2), torch.zeros(len(known), TRUTH))
        forward_s = time.perf_counter() - start_s
    batch = torch.randint(0, 255, (1, SETTINGS.batch, 64, 64, 3)).float()
    lived = (torch.zeros(1, SETTINGS.batch, 2), torch.zeros(1, SETTINGS.batch))
    state, truth = (torch.zeros(SETTINGS.batch, numbers) for numbers in (policy.units, TRUTH))
    actions = torch.zeros(SETTINGS.batch, 2)
    short = has_short_floats(torch.device("cpu"))  # as the loop that is judged by it
    start_s = time.perf_counter()
    for _ in range(rounds // 10):
        known = policy.unroll(batch, *lived, state, short)
        wheels = Normal(policy.action_net(known), policy.log_std.exp())
        loss = policy.value_of(known, truth).square().mean()
        loss = loss - wheels.log_prob(actions).mean() - wheels.entropy().mean()
        policy.optimizer.zero_grad()
        loss.backward()
        policy.optimizer.step()
    update_s = time.perf_counter() - start_s
    return {
        "forward_ms": 1e3 * forward_s / (rounds * ROBOTS),
        "update_ms": 1e3 * update_s / (rounds // 10 * SETTINGS.batch) * SETTINGS.epochs,
    }


def all_kernels(room: Any) -> dict[str, float]:
    """Milliseconds a decision takes one core, one kernel after the other."""
    return kernels(room, 480) | network_ms()


def measure(rounds: int, iterations: int) -> dict[str, Any]:
    rooms = [generate_room(seed, 512) for seed in range(6)]
    cores = os.cpu_count() or 1
    keep_freed_memory()  # as `workstation train` does; it is to plain's good too
    ours = {name: our_learner(name, rooms) for name in PRESETS}
    learners: dict[str, tuple[PPO, int]] = {name: (one, 1) for name, one in ours.items()}
    learners["plain"] = (plain_learner(rooms[0]), cores)
    speeds: dict[str, list[float]] = {name: [] for name in learners}
    bounds: list[float] = []
    for learner, threads in learners.values():
        speed(learner, 1, threads=threads)  # caches, first episodes
    with ProcessPoolExecutor(cores, get_context("spawn")) as pool:
        timed = list(pool.map(all_kernels, [rooms[0]] * cores))  # likewise
        for _ in range(rounds):
            for name, (learner, threads) in learners.items():
                speeds[name].append(speed(learner, iterations, threads=threads))
            timed = list(pool.map(all_kernels, [rooms[0]] * cores))  # as they run: all cores busy
            bounds.append(cores * 1e3 / statistics.mean(sum(one.values()) for one in timed))
    for learner, _ in learners.values():
        environment = learner.get_env()
        assert environment is not None
        environment.close()
    children_kib = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    own_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "cores": cores,
        "load_average": round(os.getloadavg()[0], 2),
        "decisions_per_s": {name: round(statistics.median(seen)) for name, seen in speeds.items()},
        "times_plain": {name: ratio(speeds[name], speeds["plain"]) for name in PRESETS},
        "kernels_ms": {
            name: round(statistics.mean(one[name] for one in timed), 3) for name in timed[0]
        },
        "kernels_decisions_per_s": round(statistics.median(bounds)),
        "share_of_kernels": {name: ratio(speeds[name], bounds) for name in PRESETS},
        "largest_process_mb": round(max(own_kib, children_kib) / 1024),
    }


def ratio(these: list[float], to_those: list[float]) -> list[float]:
    """Round by round, since a machine's speed drifts: the median, the least, the most."""
    seen = [one / other for one, other in zip(these, to_those, strict=True)]
    return [round(value, 2) for value in (statistics.median(seen), min(seen), max(seen))]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--iterations", type=int, default=2, help="of 2,048 decisions, a round")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    np.random.seed(0)
    result = measure(options.rounds, options.iterations)
    if options.json:
        print(json.dumps(result))
        return
    print(f"whole PPO loop, {result['cores']} cores, load {result['load_average']}")
    for name, value in result["decisions_per_s"].items():
        line = f"  {name:12} {value:6} decisions/s"
        if name in PRESETS:
            median, least, most = result["times_plain"][name]
            share, lowest, highest = result["share_of_kernels"][name]
            line += f", {median:.2f} ({least:.2f} to {most:.2f}) x plain"
            line += f", {share:.2f} ({lowest:.2f} to {highest:.2f}) of the kernels"
        print(line)
    print(f"  bare kernels {result['kernels_decisions_per_s']:6}: {result['kernels_ms']} at last")
    print(f"  largest process {result['largest_process_mb']} MB")


if __name__ == "__main__":
    main()
