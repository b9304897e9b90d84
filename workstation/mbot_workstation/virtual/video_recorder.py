"""A film of the virtual robot: what it sees, next to where it is."""

import threading
from pathlib import Path

import cv2
import numpy as np

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
            while (frames := pacer.wait(stop)) > 0:
                if robot.camera.newest is None:
                    continue
                status = robot.world.status()
                seen = cv2.resize(robot.camera.newest, (width, HEIGHT_PX))
                above = overhead.draw(robot.scene_state(), status.robot)
                text = f"{status.time_s:6.1f} s   {status.result.touches} touched"
                cv2.putText(
                    above, text, (10, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, TEXT_RGB, 1, cv2.LINE_AA
                )
                picture = cv2.cvtColor(np.hstack([seen, above]), cv2.COLOR_RGB2BGR)
                for _ in range(frames):  # a missed frame is shown twice: the film keeps time
                    writer.write(picture)
    finally:
        writer.release()
