"""What a sample of an update costs, by what malloc keeps and by the length of floats.

    python benchmarks/update.py

Two threads learn from the guide's advice as `workstation train` does: 512 decisions a step,
forward, backward and the optimiser. Each way has a process of its own, for what malloc is told
holds for all that comes after; ways take turns, and the best of each counts.
"""

import argparse
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import gymnasium
import numpy as np
import torch
from stable_baselines3.common.vec_env import DummyVecEnv

from mbot_workstation.learn.learning import picture_ppo
from mbot_workstation.learn.learning.learner import GUIDED, make_learner
from mbot_workstation.learn.learning.memory_policy import MEMORY_UNITS
from mbot_workstation.learn.learning.processor import has_short_floats, keep_freed_memory
from mbot_workstation.learn.learning.sequences import Sequences

LENGTH, SIDE_BY_SIDE = 32, 16
STEPS = 16
WAYS = ("as malloc is", "memory kept", "memory kept, bfloat16")


class Nothing(gymnasium.Env[np.ndarray, np.ndarray]):
    """What a learner asks for before it learns."""

    observation_space = gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))


def sample_us(way: str) -> float:
    """Microseconds a sample, wall clock."""
    torch.set_num_threads(1)
    if way != WAYS[0]:
        keep_freed_memory()
    picture_ppo.has_short_floats = lambda device: way == WAYS[2]
    network = replace(GUIDED, residual=False, first_filter_px=6)  # it learns to see by driving
    settings = replace(network, memory_units=MEMORY_UNITS, steps_per_robot=LENGTH, batch=LENGTH)
    learner = make_learner(DummyVecEnv([Nothing]), settings, seed=0)
    rng = np.random.default_rng(0)
    shape = (LENGTH, SIDE_BY_SIDE)
    batch = Sequences(
        seen=rng.integers(0, 256, (*shape, 64, 64, 3), np.uint8),
        previous_actions=np.zeros((*shape, 2), np.float32),
        forgot=np.zeros(shape, np.float32),
        state=np.zeros((SIDE_BY_SIDE, MEMORY_UNITS), np.float32),
        advice=np.ones((*shape, 2), np.float32),
        shows=np.ones(shape, np.bool_),
    )
    parts = [batch.part(index, learner.update_threads) for index in range(learner.update_threads)]
    with ThreadPoolExecutor(learner.update_threads) as threads:
        begun_s = 0.0
        for step in range(-STEPS, STEPS):
            if step == 0:
                begun_s = time.perf_counter()
            gradients = list(threads.map(learner._advice_gradients, parts))  # pyright: ignore[reportPrivateUsage]
            learner._descend(gradients, batch.decisions)  # pyright: ignore[reportPrivateUsage]
        return (time.perf_counter() - begun_s) / STEPS / batch.decisions * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--way", choices=WAYS, help="only this one, here")
    options = parser.parse_args()
    if options.way:
        print(sample_us(options.way))
        return
    ways = WAYS if has_short_floats(torch.device("cpu")) else WAYS[:2]
    us: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(options.rounds):
        for way in ways:
            told = subprocess.check_output([sys.executable, __file__, "--way", way], text=True)
            us[way].append(float(told))
    print("| update | us a sample | to the first |\n|---|---|---|")
    for way, seen in us.items():
        print(f"| {way} | {min(seen):.0f} | {min(seen) / min(us[WAYS[0]]):.2f} |")


if __name__ == "__main__":
    main()
