"""Drive with a gamepad: hold the right shoulder button, steer with the left stick; east is STOP."""

import sys

from mbot import MbotError, Robot
from mbot_workstation.fleet.by_hand.gamepad import open_gamepad

mine = sys.argv[1:]
try:
    pad, name = open_gamepad()
except MbotError as error:
    sys.exit(f"gamepad.py: {error}")
with Robot(*mine) if mine else Robot.virtual() as robot:
    print(f"{robot.name}: driven by {name}", flush=True)
    stopped = False
    while not (wish := pad.read(0.1)).end:
        if wish.stop:
            robot.stop()
        stopped = wish.wheels is not None and (stopped or wish.stop)  # until the button is let go
        if wish.wheels is None or stopped:
            robot.let_go()
        else:
            robot.drive(*wish.wheels)
