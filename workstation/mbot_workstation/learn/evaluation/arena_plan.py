"""A task's arena before anybody drives: from above, and as the robot sees it."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.evaluation.pieces_above import draw_pieces
from mbot_workstation.learn.evaluation.task_check import course_of
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.pictures.film_tile import FAINT, GAP_PX, INK, blank, write
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.find import find_task

SIDE_PX = 448
OBJECT, TAPE = (200, 30, 35), (30, 30, 30)
LINE_PX = 20


def arena_plan(reference: str, seed: int) -> Picture:
    """An episode of the lesson that all are tried in, nominal robot; shape (h, w, 3), RGB."""
    task = find_task(reference)
    lesson = course_of(task)[-1]
    scene = task.scene(SceneParameters())
    environment = TaskEnv("nominal", lesson, task=reference)
    try:
        picture, _ = environment.reset(seed=seed)
        world = environment.world
        pieces = task.pieces(world.episode)
        above = _above(world.episode.places(), pieces, world.robot, scene)
    finally:
        environment.close()
    times = SIDE_PX // len(picture)
    seen = picture.repeat(times, axis=0).repeat(times, axis=1)
    gap = blank(SIDE_PX + LINE_PX, GAP_PX)
    words = f"{task.name}, lesson {lesson.name}: {scene.arena.border_m:g} m to each side"
    return np.hstack([_titled(above, words), gap, _titled(seen, "what it sees first")])


def _above(
    places: Mapping[int, Pose], pieces: Sequence[Distractor], robot: Pose, scene: SceneParameters
) -> Picture:
    area, reach_m = blank(SIDE_PX, SIDE_PX), scene.arena.border_m + 0.2

    def at(x_m: float, y_m: float) -> tuple[int, int]:
        """Ahead of the robot's first heading is up, its left is left."""
        half, scale = SIDE_PX / 2, SIDE_PX / 2 / reach_m
        return round(half - y_m * scale), round(half - x_m * scale)

    border_m = scene.arena.border_m
    cv2.rectangle(area, at(border_m, border_m), at(-border_m, -border_m), FAINT, 1)
    for mark in scene.marks:
        points = np.array([at(*point) for point in mark.points_m], np.int32)
        cv2.polylines(area, [points], isClosed=False, color=TAPE, thickness=2)
    draw_pieces(area, pieces, at)
    for number, place in places.items():
        thing = scene.objects[number]
        radius = max(3, round(thing.width_m / 2 * SIDE_PX / 2 / reach_m))
        cv2.circle(area, at(place.x_m, place.y_m), radius, OBJECT, -1)
    ahead = Pose(robot.x_m + 0.25, robot.y_m)
    cv2.circle(area, at(robot.x_m, robot.y_m), 6, INK, 2)
    cv2.arrowedLine(area, at(robot.x_m, robot.y_m), at(ahead.x_m, ahead.y_m), INK, 2)
    return area


def _titled(picture: Picture, words: str) -> Picture:
    line = blank(LINE_PX, picture.shape[1])
    write(line, words.encode("ascii", "replace").decode(), (2, 14), INK, 0.4)
    return np.vstack([line, picture])
