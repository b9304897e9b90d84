"""A daemon's motor thread in a process of its own, for tests that kill or freeze it.

Usage: driving_process.py PORT. Drives for ever, with a new command five times a second.
"""

import sys
import time

from mbot_agent.board.motors import Motors
from mbot_agent.configuration import Board
from mbot_protocol.drive.mcore import Joystick
from mbot_protocol.drive.wheel_command import WheelCommand


def main() -> None:
    with Motors(Board(port=sys.argv[1])) as motors:
        while motors.fault is not None:
            time.sleep(0.01)
        motors.arm()  # once: as after one `run`
        while True:
            ten_seconds_ns = time.monotonic_ns() + 10_000_000_000
            motors.drive(WheelCommand(Joystick(-100, 100).duties, ten_seconds_ns))
            time.sleep(0.2)


if __name__ == "__main__":
    main()
