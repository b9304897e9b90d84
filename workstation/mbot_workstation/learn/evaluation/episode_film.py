"""A film of one episode, all contestants side by side: what each sees, and its way from above."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.learn.drivers.contestants import Driver, driver
from mbot_workstation.learn.evaluation.episodes import Trial
from mbot_workstation.learn.evaluation.pieces_above import draw_pieces
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.pose import Pose

SIDE_PX = 5 * OBSERVATION_SIDE_PX
LINE_PX = 24
RATE_HZ = 2.5
"""A picture a decision: the film runs as fast as the robot."""

MOST_DECISIONS = 600
"""Four minutes; an episode of ten objects takes 1.5."""

REACH_M = 3.0
"""From the middle to the map's edge; lesson 10 puts objects up to 2.5 m away."""

FLOOR_RGB, PATH_RGB, ROBOT_RGB, OBJECT_RGB = (
    (235, 235, 230),
    (120, 150, 200),
    (20, 60, 150),
    (200, 30, 30),
)


class Reel:
    """One contestant's episode, decision by decision."""

    def __init__(self, title: str, contestant: str, trial: Trial) -> None:
        self._title = title
        self._driver: Driver = driver(
            contestant, 1, trial.seed, trial.preset, trial.robot, trial.task
        )
        self._environment = TaskEnv(
            trial.preset,
            trial.lesson,
            trial.rooms,
            trial.robot,
            trial.scene,
            task=trial.task,
        )
        self._seen, self._info = self._environment.reset(seed=trial.seed)
        self._path: list[Pose] = [self._environment.world.robot]
        self._reward, self._decisions = 0.0, 0
        self.ended = False

    def step(self) -> None:
        """Decide once, unless the episode has ended."""
        if self.ended:
            return
        action: Any = self._driver.act(self._seen[np.newaxis], [self._info])
        self._seen, reward, self.ended, _, self._info = self._environment.step(action[0])
        self._reward += reward
        self._decisions += 1
        self._path.append(self._environment.world.robot)

    def picture(self) -> Picture:
        """Words, what it sees, its way. Shape (2 SIDE_PX + LINE_PX, SIDE_PX, 3), RGB."""
        words = np.full((LINE_PX, SIDE_PX, 3), 255, np.uint8)
        state = "ended" if self.ended else f"{self._decisions / RATE_HZ:.0f} s"
        task = self._environment.world.task
        count = f"{self._info[task.counted]} {task.counted_done}"
        text = f"{self._title}: {count}, {self._reward:+.1f}, {state}"
        cv2.putText(words, text, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
        times = SIDE_PX // OBSERVATION_SIDE_PX
        seen = self._seen.repeat(times, axis=0).repeat(times, axis=1)
        return np.vstack([words, seen, self._map()])

    def close(self) -> None:
        """Give the OpenGL resources back."""
        self._environment.close()

    def _map(self) -> NDArray[np.uint8]:
        above = np.full((SIDE_PX, SIDE_PX, 3), FLOOR_RGB, np.uint8)
        world = self._environment.world
        draw_pieces(above, world.task.pieces(world.episode), _pixel)
        places = [_pixel(pose.x_m, pose.y_m) for pose in self._path]
        cv2.polylines(above, [np.array(places, np.int32)], False, PATH_RGB, 1, cv2.LINE_AA)
        robot = self._path[-1]
        nose = _pixel(
            robot.x_m + 0.2 * np.cos(robot.yaw_rad), robot.y_m + 0.2 * np.sin(robot.yaw_rad)
        )
        cv2.arrowedLine(above, places[-1], nose, ROBOT_RGB, 2, cv2.LINE_AA, tipLength=0.4)
        for place in world.episode.places().values():
            x_px, y_px = _pixel(place.x_m, place.y_m)
            cv2.rectangle(above, (x_px - 3, y_px - 3), (x_px + 3, y_px + 3), OBJECT_RGB, -1)
        return above


def film_episode(contestants: Mapping[str, str], trial: Trial, path: Path) -> int:
    """Film the trial's first episode, the same for all, until the last has ended.

    Args:
        contestants: by title, see `driver`.
        trial: the task, robots and rooms; its seed is the episode's.
        path: of the film, MP4.

    Returns:
        How many decisions it shows.

    Raises:
        ConfigurationError: it can't be written.

    """
    reels = [Reel(title, contestant, trial) for title, contestant in contestants.items()]
    size = SIDE_PX * len(reels), 2 * SIDE_PX + LINE_PX
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, size)
    if not writer.isOpened():
        raise ConfigurationError(f"can't write a film to {path}; give a writable NAME.mp4")
    decisions = 0
    try:
        while decisions < MOST_DECISIONS and not all(reel.ended for reel in reels):
            for reel in reels:
                reel.step()
            decisions += 1
            picture = np.hstack([reel.picture() for reel in reels])
            writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    finally:
        writer.release()
        for reel in reels:
            reel.close()
    return decisions


def _pixel(x_m: float, y_m: float) -> tuple[int, int]:
    """Column and row; +x is right, +y is up."""
    scale = SIDE_PX / (2 * REACH_M)
    return round(SIDE_PX / 2 + x_m * scale), round(SIDE_PX / 2 - y_m * scale)
