"""What a policy's memory is worth: the same episodes with the memory as it is, and taken away.

    python benchmarks/memory.py models/red-cube.onnx --episodes 16 --panorama studio.jpg

zeroed: the state is zeroed before every decision, the last action is told. blind: so is the last
action. shuffled: before every decision each robot gets another one's state. frozen: the
state is held as it was after an episode's first 20 decisions. A policy that only carries a memory
along does as well without it.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.learn.drivers.contestants import Driver
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy
from mbot_workstation.learn.evaluation.episodes import Trial, evaluate_driver, robots_of, score
from mbot_workstation.learn.evaluation.provenance import provenance
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named

FROZEN_AFTER = 20
"""Decisions, 8 s: what the paper's policy takes for an object."""

PRESETS = ("nominal", "handicap", "late", "slippery", "any-room")


def zeroed(policy: OnnxPolicy) -> None:
    policy.state[:] = 0


def blind(policy: OnnxPolicy) -> None:
    policy.forget()


def shuffled(policy: OnnxPolicy) -> None:
    policy.state[:] = np.roll(policy.state, 1, axis=1)


class Frozen:
    """Holds each robot's state once it has made so many decisions; a state of zeros starts over."""

    def __init__(self) -> None:
        self._decisions: NDArray[np.int64] = np.zeros(0, np.int64)
        self._kept: NDArray[np.float32] = np.zeros(0, np.float32)

    def __call__(self, policy: OnnxPolicy) -> None:
        if self._kept.shape != policy.state.shape:
            self._kept, self._decisions = policy.state.copy(), np.zeros(policy.state.shape[1], int)
        begins = ~policy.state.any(axis=(0, 2))
        self._decisions = np.where(begins, 0, self._decisions + 1)
        held = self._decisions > FROZEN_AFTER
        self._kept = np.where(held[:, None], self._kept, policy.state)
        policy.state[:] = self._kept


TAKEN_AWAY: dict[str, Callable[[OnnxPolicy], None]] = {
    "as it is": lambda _: None,
    "zeroed": zeroed,
    "blind": blind,
    "shuffled": shuffled,
    "frozen": Frozen(),
}


def main() -> None:
    """Print a table, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("policy", type=Path, help="an ONNX policy with memory")
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--panorama", type=Path, action="append", default=[])
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rooms = evaluation_rooms(options.panorama)
    found: dict[str, dict[str, float]] = {}
    for name in PRESETS:
        trial = Trial(lesson_named(TASK.lessons, "10"), preset(name), rooms, options.episodes)
        found[name] = {}
        for what, take_away in TAKEN_AWAY.items():
            policy = OnnxPolicy.load(options.policy)
            policy.act(np.zeros((robots_of(trial), 64, 64, 3), np.uint8))
            policy.forget()

            def act(pictures: np.ndarray, _: object, policy: OnnxPolicy = policy) -> np.ndarray:
                take_away(policy)  # noqa: B023 (used before the next one is drawn)
                return policy.act(pictures)

            results = evaluate_driver(Driver(act, policy.forget), trial)
            found[name][what] = score(results).reward.mean
    if options.json:
        print(json.dumps(found, indent=2))
        return
    print(f"{provenance([str(options.policy)])} {options.episodes} episodes, mean reward of 21.\n")
    print("| preset | " + " | ".join(TAKEN_AWAY) + " |")
    print("|---" * (len(TAKEN_AWAY) + 1) + "|")
    for name, rewards in found.items():
        print(f"| {name} | " + " | ".join(f"{reward:.2f}" for reward in rewards.values()) + " |")


if __name__ == "__main__":
    main()
