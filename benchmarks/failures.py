"""What a policy saw before it failed: a sheet of pictures of every episode without all its objects.

    python benchmarks/failures.py models/red-cube.onnx any-room --episodes 100 -o out/failures

The episodes are those of `workstation evaluate MODEL --preset PRESET`. Row by row, the last
picture is that of the last decision. Means tell how often a policy fails; these tell why.
"""

import argparse
from collections import deque
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mbot_workstation.training.drivers.contestants import driver
from mbot_workstation.training.evaluation.episodes import MOST_ROBOTS
from mbot_workstation.training.worlds.fetch_vec_env import FetchVecEnv
from mbot_workstation.training.worlds.lessons import lesson
from mbot_workstation.training.worlds.rooms import evaluation_rooms
from mbot_workstation.variation.presets import preset

COLUMNS, ROWS = 8, 4
SIDE_PX = 160
UNKNOWN = np.full((MOST_ROBOTS, 2), np.nan)


def sheet(pictures: "deque[np.ndarray]") -> np.ndarray:
    """The pictures, BGR as OpenCV writes them, the last one at the end."""
    black = [np.zeros_like(pictures[-1])] * (COLUMNS * ROWS - len(pictures))
    rows = np.stack([*black, *pictures]).reshape(ROWS, COLUMNS, *pictures[-1].shape)
    whole = np.vstack([np.hstack(row) for row in rows])[..., ::-1]
    size = COLUMNS * SIDE_PX, ROWS * SIDE_PX
    return cv2.resize(np.ascontiguousarray(whole), size, interpolation=cv2.INTER_NEAREST)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("model")
    parser.add_argument("preset")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--into", type=Path, default=Path("out/failures"))
    told = parser.parse_args()
    told.into.mkdir(parents=True, exist_ok=True)
    task, ranges = lesson("10"), preset(told.preset)
    driven = driver(told.model, MOST_ROBOTS, told.seed, ranges)
    environment = FetchVecEnv(
        robots=MOST_ROBOTS,
        seed=told.seed * MOST_ROBOTS,
        preset=ranges,
        lesson=task,
        rooms=evaluation_rooms([]),
    )
    seen = [deque[np.ndarray](maxlen=COLUMNS * ROWS) for _ in range(MOST_ROBOTS)]
    left = [len(range(robot, told.episodes, MOST_ROBOTS)) for robot in range(MOST_ROBOTS)]
    try:
        pictures: Any = environment.reset()
        while any(left):
            for robot, picture in enumerate(pictures):
                seen[robot].append(picture.copy())
            pictures, _, ended, infos = environment.step(driven.act(pictures, UNKNOWN))
            driven.forget(ended)
            for robot in np.flatnonzero(ended):
                how = infos[robot]
                if left[robot] and how["touches"] < task.objects:
                    episode = len(range(robot, told.episodes, MOST_ROBOTS)) - left[robot] + 1
                    file = told.into / f"robot-{robot}-episode-{episode}-{how['happening']}.png"
                    cv2.imwrite(str(file), sheet(seen[robot]))
                    print(f"{file}: {how['touches']} of {task.objects} touched, {how['happening']}")
                left[robot] -= left[robot] > 0
                seen[robot].clear()
    finally:
        environment.close()


if __name__ == "__main__":
    main()
