"""A camera's automatics left alone, held while a robot drives, or held from elsewhere.

    python benchmarks/automatics.py models/red-cube.onnx servo --episodes 400

The three settings of the daemon's `camera.automatic`, simulated in arenas that look like any, the
same episodes for each. `always`: exposure and white balance follow every picture. `settle`: they
stay as they were at an episode's start. `off`: as they were somewhere else in the same arena, up to
1.5 m away and turned any way, where the daemon was started. Behind it are the means of the
differences from `settle`, episode by episode; intervals are of 95 %.
"""

import argparse
import math
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.drivers.contestants import driver, title
from mbot_workstation.learn.evaluation.episodes import EpisodeResult, score
from mbot_workstation.learn.evaluation.provenance import provenance
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named

PRESETS = {"settle": "light-held", "always": "any-room", "off": "light-held"}
FAR_M = 1.5
SHARES = 4
"""Jobs of a setting; each builds its own arenas."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("contestants", nargs="+", help="ONNX files, or servo")
    parser.add_argument("--episodes", type=int, default=400)
    options = parser.parse_args()
    print(f"{provenance(options.contestants)} {options.episodes} episodes each.\n")
    print("| policy | setting | reward | all ten touched | against settle |")
    print("|---|---|---|---|---|")
    numbers = [range(options.episodes)[share::SHARES] for share in range(SHARES)]
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        for contestant in options.contestants:
            settled = np.empty(0)
            for setting in PRESETS:
                parts = pool.map(partial(drive, contestant, setting), numbers)
                results = [result for part in parts for result in part]
                rewards, told = np.array([result.reward for result in results]), score(results)
                settled = rewards if setting == "settle" else settled
                print(
                    f"| {title(contestant)} | {setting} | {told.reward.mean:.2f} "
                    f"({told.reward.low:.2f} to {told.reward.high:.2f}) | "
                    f"{told.success.mean:.1%} | {against(rewards - settled)} |",
                    flush=True,
                )


def against(differences: np.ndarray) -> str:
    """The mean of the differences, and how sure it is."""
    error = 1.96 * differences.std() / math.sqrt(len(differences))
    return f"{differences.mean():+.3f} ± {error:.3f}" if differences.any() else ""


def drive(contestant: str, setting: str, episodes: range) -> list[EpisodeResult]:
    """These episodes with the automatics set so."""
    ranges, task = preset(PRESETS[setting]), lesson_named(TASK.lessons, "10")
    environment = TaskEnv(ranges, task, evaluation_rooms([]))
    results: list[EpisodeResult] = []
    for number in episodes:
        who = driver(contestant, 1, number, ranges)
        picture, info = environment.reset(seed=number)
        if setting == "off":
            picture = opened_elsewhere(environment, number)
        reward, decisions, ended = 0.0, 0, False
        while not ended:
            action = who.act(picture[np.newaxis], [info])[0]
            picture, score_now, ended, _, info = environment.step(action)
            reward, decisions = reward + score_now, decisions + 1
        touches = info["touches"]
        results.append(EpisodeResult(reward, decisions, touches, touches == task.goal))
    environment.close()
    return results


def opened_elsewhere(environment: TaskEnv, seed: int) -> Picture:
    """Let the camera settle somewhere else, and carry the robot to its start."""
    world, rng = environment.world, np.random.default_rng(seed)
    start, (x_m, y_m) = world.glimpse, rng.uniform(-FAR_M, FAR_M, 2)
    world.simulation.place_robot(Pose(x_m, y_m, rng.uniform(-math.pi, math.pi)))
    world.camera.begin(0.0)
    world.glimpse = world._look()  # pyright: ignore[reportPrivateUsage]: nobody else carries robots
    environment._observe()  # pyright: ignore[reportPrivateUsage]: the automatics settle on this
    world.simulation.place_robot(ORIGIN)
    world.glimpse = start
    return environment._observe()  # pyright: ignore[reportPrivateUsage]


if __name__ == "__main__":
    main()
