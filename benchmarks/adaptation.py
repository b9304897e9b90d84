"""How soon a policy has learned another robot: a motor gives way in mid-drive.

    python benchmarks/adaptation.py models/red-cube.onnx --plot adaptation.png

Robots of the preset `nominal`; after 60 decisions the left motor has half its force. Told is how
far they come towards their objects per decision, against the guide, which knows robot and object;
and by how much the wheels' commands differ while the object is straight ahead, which is what a
robot that pulls to one side needs.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_workstation.learn.drivers.onnx_policy import Actions, OnnxPolicy
from mbot_workstation.learn.evaluation.provenance import provenance
from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.guidance import GUIDE_REMEMBERS
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.tasks.fetch.guide import FetchGuide
from mbot_workstation.tasks.fetch.lessons import FetchLesson

SWAP_AFTER = 60
DECISIONS = 140
WINDOW = 10
AHEAD_RAD = 0.17
NEAR = 0.9
"""Of its progress before the change, both against the guide's: as good as learned."""

SWAP = FetchLesson(
    "swap",
    2.5,
    objects=10,
    changes=1.0,
    change_after=(SWAP_AFTER, SWAP_AFTER + 1),
    change_to=(("left_gain", (0.5, 0.5)),),
)


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What robots did in their first episodes; NaN where nothing counts.

    Attributes:
        progress_m: towards the object in each decision, shape (decisions, robots).
        turn: right wheel's command minus the left one's while the object was straight ahead, shape
            (decisions, robots).

    """

    progress_m: NDArray[np.float64]
    turn: NDArray[np.float64]


class Driven:
    """A policy, its memory zeroed before every decision or not."""

    def __init__(self, path: Path, robots: int, *, remembers: bool) -> None:
        self._policy = OnnxPolicy.load(path)
        self._policy.act(np.zeros((robots, 64, 64, 3), np.uint8))
        self._policy.forget()
        self._remembers = remembers

    def act(self, environment: TaskVecEnv, pictures: NDArray[np.uint8]) -> Actions:
        """Both wheels of every robot."""
        del environment
        if not self._remembers:
            self._policy.forget()
        return self._policy.act(pictures)


class Guided:
    """The guide, told what the robots are like."""

    def __init__(self, robots: int) -> None:
        self._guide = FetchGuide(robots, preset("nominal"), remembers=GUIDE_REMEMBERS)

    def act(self, environment: TaskVecEnv, pictures: NDArray[np.uint8]) -> Actions:
        """Both wheels of every robot."""
        del pictures
        sight = environment.observations()
        self._guide.become(sight.bodies)
        asked = torch.from_numpy(np.nan_to_num(self._guide.act(sight.situations)))
        actions = within_full_speed(asked).numpy()
        self._guide.drove(actions)
        return actions


def drive(driver: Driven | Guided, robots: int) -> Drive:
    """Let robots drive, and change them on the way."""
    progress = np.full((DECISIONS, robots), np.nan)
    turn = np.full((DECISIONS, robots), np.nan)
    with TaskVecEnv(robots, 0, preset("nominal"), SWAP, evaluation_rooms([])) as environment:
        pictures: Any = environment.reset()
        first_episode = np.ones(robots, np.bool_)
        for decision in range(DECISIONS):
            before = environment.observations().situations
            actions = driver.act(environment, pictures)
            pictures, _, ended, _ = environment.step(actions)
            first_episode &= ~ended
            after = environment.observations().situations
            same_object = after["touches"] == before["touches"]
            counts = first_episode & same_object
            progress[decision] = np.where(counts, _distance_m(before) - _distance_m(after), np.nan)
            ahead = first_episode & (np.abs(before["seen_left_rad"]) < AHEAD_RAD)
            turn[decision] = np.where(ahead, actions[:, 1] - actions[:, 0], np.nan)
    return Drive(progress, turn)


def _distance_m(situations: NDArray[np.void]) -> NDArray[np.float64]:
    return np.hypot(situations["target_ahead_m"], situations["target_left_m"])


def windows(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means of WINDOW decisions of all robots; shape (decisions // WINDOW,)."""
    return np.nanmean(values.reshape(len(values) // WINDOW, -1), axis=1)


def near_after(share: NDArray[np.float64]) -> int | None:
    """Decisions from the change until a window first is NEAR what was before; None if none is."""
    change = SWAP_AFTER // WINDOW
    later = np.flatnonzero(share[change:] >= NEAR * share[:change].mean())
    return None if not len(later) else int((later[0] + 1) * WINDOW)


def plot(shares: dict[str, NDArray[np.float64]], drives: dict[str, Drive], path: Path) -> None:
    """Progress against the guide's, and the difference of the wheels, over decisions."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 6), layout="constrained")
    above, below = figure.subplots(2, sharex=True)
    decisions = np.arange(DECISIONS // WINDOW) * WINDOW + WINDOW / 2
    for name, share in shares.items():
        above.plot(decisions, share, marker="o", label=name)
    for name, one in drives.items():
        below.plot(decisions, windows(one.turn), marker="o", label=name)
    for axes in (above, below):
        axes.axvline(SWAP_AFTER, color="grey", linestyle="--")
        axes.grid(alpha=0.3)
    above.set_ylabel("progress, share of the guide's")
    below.set_ylabel("right - left wheel\nwhile straight ahead")
    below.set_xlabel("decisions; dashed: the left motor loses half its force")
    above.legend()
    save_figure(figure, path)


def main() -> None:
    """Print a table, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("policy", type=Path, help="an ONNX policy with memory")
    parser.add_argument("--robots", type=int, default=64)
    parser.add_argument("--plot", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    robots = options.robots
    drives = {
        "with its memory": drive(Driven(options.policy, robots, remembers=True), robots),
        "without": drive(Driven(options.policy, robots, remembers=False), robots),
        "guide": drive(Guided(robots), robots),
    }
    best = windows(drives["guide"].progress_m)
    shares = {name: windows(one.progress_m) / best for name, one in drives.items()}
    if options.plot is not None:
        plot(shares, drives, options.plot)
    if options.json:
        found = {name: {"share": list(np.round(share, 3))} for name, share in shares.items()}
        print(json.dumps(found, indent=2))
        return
    print(f"{provenance([str(options.policy)])} {robots} robots.\n")
    print("| decisions after the change | " + " | ".join(shares) + " |")
    print("|---" * (len(shares) + 1) + "|")
    for window in range(DECISIONS // WINDOW):
        after = window * WINDOW - SWAP_AFTER
        cells = " | ".join(f"{share[window]:.2f}" for share in shares.values())
        print(f"| {after} to {after + WINDOW} | {cells} |")
    soon = near_after(shares["with its memory"])
    print(
        f"\nWith its memory: {NEAR:.0%} of its progress before the change after {soon} decisions."
    )


if __name__ == "__main__":
    main()
