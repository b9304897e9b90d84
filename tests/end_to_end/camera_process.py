"""A camera server as a process of its own, so that tests can kill or freeze it.

`python camera_process.py PORT` serves 30 noisy pictures a second.
"""

import sys
import time

import cv2
import numpy as np

from mbot_workstation.virtual.mjpeg_server import MjpegServer


def main() -> None:
    rng = np.random.default_rng(0)
    with MjpegServer(int(sys.argv[1])) as server:
        due_s = time.monotonic()
        while True:
            picture = rng.integers(0, 256, (60, 80, 3), np.uint8).repeat(4, 0).repeat(4, 1)
            server.publish(cv2.imencode(".jpg", picture)[1].tobytes())
            due_s += 1 / 30
            time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    main()
