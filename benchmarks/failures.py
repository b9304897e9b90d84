"""What a policy saw before it failed: a sheet of pictures of every episode without all its objects.

    python benchmarks/failures.py models/red-cube.onnx any-room --episodes 100 -o out/failures

The episodes are those of `workstation evaluate MODEL --preset PRESET`. Row by row, the last
picture is that of the last decision. Means tell how often a policy fails; these tell why.
"""

import argparse
from collections import deque
from pathlib import Path

import cv2
import numpy as np

from mbot_workstation.learn.drivers.contestants import Driver, driver
from mbot_workstation.learn.evaluation.episodes import Trial, evaluate_driver, robots_of
from mbot_workstation.learn.worlds.lessons import lesson
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.sim.effects.presets import preset

COLUMNS, ROWS = 8, 4
SIDE_PX = 160

Pictures = deque[np.ndarray]


class Watched:
    """A driver whose pictures are kept: the last ones of every episode, robot by robot."""

    def __init__(self, driven: Driver, robots: int) -> None:
        self.episodes: list[list[Pictures]] = [[] for _ in range(robots)]
        self._driven = driven
        self._seen = [self._nothing() for _ in range(robots)]

    def driver(self) -> Driver:
        return Driver(self._act, self._forget)

    def _act(self, pictures: np.ndarray, targets: np.ndarray) -> np.ndarray:
        for seen, picture in zip(self._seen, pictures, strict=True):
            seen.append(picture.copy())
        return self._driven.act(pictures, targets)

    def _forget(self, ended: np.ndarray) -> None:
        self._driven.forget(ended)
        for robot in np.flatnonzero(ended):
            self.episodes[robot].append(self._seen[robot])
            self._seen[robot] = self._nothing()

    @staticmethod
    def _nothing() -> Pictures:
        return deque(maxlen=COLUMNS * ROWS)


def sheet(pictures: Pictures) -> np.ndarray:
    """The pictures in one, BGR as OpenCV writes it, the last one at the end."""
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
    rooms = evaluation_rooms([])
    trial = Trial(lesson("10"), preset(told.preset), rooms, told.episodes, told.seed)
    robots = robots_of(trial)
    watched = Watched(driver(told.model, robots, trial.seed, trial.preset), robots)
    results = iter(evaluate_driver(watched.driver(), trial))
    for robot, episodes in enumerate(watched.episodes):
        share = len(range(robot, trial.episodes, robots))  # a quick robot drives more, uncounted
        for number, pictures in enumerate(episodes[:share], 1):
            result = next(results)
            if not result.completed:
                file = told.into / f"robot-{robot}-episode-{number}.png"
                cv2.imwrite(str(file), sheet(pictures))
                print(f"{file}: {result.touches} touched in {result.decisions} decisions")


if __name__ == "__main__":
    main()
