"""The alternative that `benchmarks/agent.py` compares with: a naive baseline.

OpenCV's reader, onnxruntime as it comes, pyserial, every twelfth frame: one thread, no deadlines,
no checks. Runs for some seconds, then prints one JSON object.
"""

import json
import sys
import time

import cv2
import numpy as np
import onnxruntime
import serial

from mbot_protocol.drive.actions import WheelMaps, to_steps
from mbot_protocol.drive.mcore import STOP, Acknowledgement, Joystick, ReplyParser

FRAMES_A_DECISION = 12
"""2.5 decisions a second at 30 frames/s. Frames must be taken as they come: with a sleep of 0.4 s
instead, old frames pile up in the socket and the server lets go after some seconds (measured)."""


def main() -> None:
    camera, port, model, seconds = sys.argv[1:5]
    capture = cv2.VideoCapture(camera)
    board = serial.Serial(port, 115200, timeout=0.1)
    session = onnxruntime.InferenceSession(model)
    wheels, parser = WheelMaps(), ReplyParser()
    decision_ms: list[float] = []
    began_s, cpu_s = time.monotonic(), time.process_time()
    while time.monotonic() - began_s < float(seconds):
        for _ in range(FRAMES_A_DECISION):
            capture.grab()
        started_s = time.monotonic()
        _, frame = capture.retrieve()
        rgb = cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
        observation = cv2.resize(rgb, (64, 64), interpolation=cv2.INTER_AREA)
        action = session.run(None, {"observation": np.asarray(observation)[None]})[0]
        left, right = np.asarray(action).reshape(2)
        duties = wheels.duties(to_steps(float(left), float(right)))
        board.write(Joystick.of(wheels.at_motors(duties)).to_bytes())
        while not any(isinstance(reply, Acknowledgement) for reply in parser.feed(board.read(4))):
            pass
        decision_ms.append((time.monotonic() - started_s) * 1e3)
    elapsed_s = time.monotonic() - began_s
    board.write(STOP.to_bytes())
    print(
        json.dumps(
            {
                "decision_ms": decision_ms,
                "decisions_per_s": len(decision_ms) / elapsed_s,
                "cpu_share": (time.process_time() - cpu_s) / elapsed_s,
            }
        )
    )


if __name__ == "__main__":
    main()
