"""A film of the virtual robot: what it sees, next to where it is."""

import threading
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pacer import Pacer
from mbot_workstation.virtual.overhead_view import OverheadView
from mbot_workstation.virtual.stand_in import VirtualRobot

RATE_HZ = 10
"""Enough to follow 0.4 m/s, and a quarter of what the camera itself costs."""

HEIGHT_PX = 480
TEXT_RGB = (20, 20, 20)


def record(robot: VirtualRobot, path: Path, stop: threading.Event) -> None:
    """Film until stopped; in a thread of its own, since drawing takes as long as it takes.

    Raises:
        ConfigurationError: the file can't be written.

    """
    width = HEIGHT_PX * 4 // 3
    writer = cv2.VideoWriter(
        str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE_HZ, (width + HEIGHT_PX, HEIGHT_PX)
    )
    if not writer.isOpened():
        raise ConfigurationError(f"can't write a film to {path}; give a writable NAME.mp4")
    try:
        with OverheadView(robot.simulation, HEIGHT_PX) as overhead:
            pacer = Pacer(1 / RATE_HZ, RATE_HZ)
            shown = 0
            while (frames := pacer.wait(stop)) > 0:
                if robot.camera.newest is not None:
                    picture = _picture(robot, robot.camera.newest, overhead, width)
                    for _ in range(frames):  # a missed frame is shown twice: the film keeps time
                        writer.write(picture)
                    shown += frames
            # No player opens a film without a picture: a short session on a busy machine.
            if shown == 0 and robot.camera.newest is not None:
                writer.write(_picture(robot, robot.camera.newest, overhead, width))
    finally:
        writer.release()


def _picture(
    robot: VirtualRobot, seen: Picture, overhead: OverheadView, width: int
) -> NDArray[np.uint8]:
    """What the camera sees beside the robot from above, shape (height, width + height, 3), BGR."""
    status = robot.world.status()
    above = overhead.draw(robot.scene_state(), status.robot)
    task = robot.world.task
    text = f"{status.time_s:6.1f} s   {status.result[task.counted]} {task.counted_done}"
    cv2.putText(above, text, (10, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, TEXT_RGB, 1, cv2.LINE_AA)
    beside = np.hstack([cv2.resize(seen, (width, HEIGHT_PX)), above])
    return np.asarray(cv2.cvtColor(beside, cv2.COLOR_RGB2BGR), np.uint8)
