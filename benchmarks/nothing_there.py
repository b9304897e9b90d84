"""How far policies drive where there is no object: on a table this is what counts.

    python benchmarks/nothing_there.py models/red-cube.onnx servo

A simulated robot begins in the middle of the nominal arena, 2.9 m from its border, and drives for
64 s with the object out of the world. Told are how far it came from where it began, in half of the
episodes and at most, its way, and in how many episodes it touched the border.
"""

import argparse

import numpy as np

from mbot_workstation.learn.drivers.contestants import driver, title
from mbot_workstation.learn.evaluation.provenance import provenance
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.sim.pose import Pose
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named

PRESETS = ("nominal", "any-room")
DECISIONS = 160
"""Fewer than an object's time, so that no episode ends by it."""

NOWHERE = Pose(60.0, 60.0, 0.0)


def drive(contestant: str, environment: TaskEnv, preset_name: str, seed: int) -> np.ndarray:
    """Where the robot was after every decision, metres from its start: shape (decisions, 2)."""
    who = driver(contestant, 1, seed, preset(preset_name))
    environment.reset(seed=seed)
    world = environment.world
    world.episode.target = NOWHERE  # pyright: ignore[reportAttributeAccessIssue]: of fetch
    world.simulation.place_object(NOWHERE)
    picture, _, ended, _, info = environment.step(np.zeros(2, np.float32))
    places = [(0.0, 0.0)]
    while len(places) < DECISIONS and not ended:
        action = who.act(picture[np.newaxis], [info])[0]
        picture, _, ended, _, info = environment.step(action)
        places.append((world.robot.x_m, world.robot.y_m))
    return np.array(places)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("contestants", nargs="+", help="ONNX files, or servo")
    parser.add_argument("--episodes", type=int, default=24)
    options = parser.parse_args()
    rooms = evaluation_rooms([])
    print(f"{provenance(options.contestants)} {options.episodes} episodes each.\n")
    print("| preset | policy | furthest, m: median | at most | way, m: median | border |")
    print("|---|---|---|---|---|---|")
    for name in PRESETS:
        environment = TaskEnv(preset(name), lesson_named(TASK.lessons, "10"), rooms)
        border_m = environment.world.simulation.scene.arena.border_m
        for contestant in options.contestants:
            drives = [drive(contestant, environment, name, n) for n in range(options.episodes)]
            furthest = [np.hypot(*places.T).max() for places in drives]
            ways = [np.hypot(*np.diff(places, axis=0).T).sum() for places in drives]
            borders = sum(np.abs(places[-1]).max() >= border_m for places in drives)
            print(
                f"| {name} | {title(contestant)} | {np.median(furthest):.1f} | "
                f"{max(furthest):.1f} | {np.median(ways):.1f} | {borders} |",
                flush=True,
            )
        environment.close()


if __name__ == "__main__":
    main()
