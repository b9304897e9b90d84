"""Watch a robot decide. `watch.py ROBOT` watches yours, and sets nothing in motion."""

import sys

from mbot import Robot

mine = sys.argv[1:]
with Robot(*mine) if mine else Robot.virtual(policy="servo") as robot:
    if not mine:
        robot.run()
    for beat in robot.beats(seconds=6):
        wheels = "left {:+.2f}, right {:+.2f}".format(*beat.action) if beat.action else "no action"
        brightness = "" if beat.frame is None else f", brightness {beat.frame.mean():.0f}"
        print(f"{robot.name} {beat.number:4}: {beat.state}, {wheels}{brightness}", flush=True)
