"""Two robots at once. `several_robots.py ROBOT ROBOT` takes yours: clear the floor."""

import sys
import time
from contextlib import ExitStack

from mbot import Robot

DANCE = {"ahead": (0.5, 0.5), "left": (-0.3, 0.3), "right": (0.3, -0.3), "back": (-0.5, -0.5)}

with ExitStack() as stack:
    robots = [Robot(name) for name in sys.argv[1:]] or [
        Robot.virtual(name=name, options=["--plain"]) for name in ("anna", "ben")
    ]
    robots = [stack.enter_context(robot) for robot in robots]
    for step, wheels in DANCE.items():
        for robot in robots:
            robot.drive(*wheels)  # until the next word
        time.sleep(0.6)
        print(f"{step}: {', '.join(f'{one.name} {one.state().state}' for one in robots)}")
