"""Turn until something red is in the picture, then drive at it: OpenCV in place of a policy."""

import sys

import cv2

from mbot import Robot

TURN, AHEAD = 0.25, 0.5

mine = sys.argv[1:]
with Robot(*mine) if mine else Robot.virtual() as robot:
    for picture in robot.frames(seconds=12):
        hue, saturation, value = cv2.split(cv2.cvtColor(picture, cv2.COLOR_RGB2HSV))
        red = ((hue < 8) | (hue > 172)) & (saturation > 140) & (value > 60)
        columns = red[28:].nonzero()[1]  # below the horizon
        if len(columns) < 4:
            robot.drive(TURN, -TURN)
            print("nothing red, turning", flush=True)
        else:
            aside = columns.mean() / 31.5 - 1  # -1 at the left edge, 1 at the right
            robot.drive(AHEAD + TURN * aside, AHEAD - TURN * aside)
            print(f"{len(columns)} red pixels, {aside:+.2f} aside, driving at them", flush=True)
