"""Drive a square by hand: nothing is measured, so it is as square as the motors are alike."""

import sys

from mbot import Robot

SIDE = (0.5, 0.5, 1.0)  # left and right wheel, seconds: 20 cm
CORNER = (-0.26, 0.26, 1.0)  # 90 degrees to the left, on the nominal robot

mine = sys.argv[1:]
with Robot(*mine) if mine else Robot.virtual() as robot:
    for side in range(1, 5):
        robot.drive(*SIDE)
        robot.drive(*CORNER)
        print(f"{robot.name}: side {side}, {robot.state().state}", flush=True)
