"""What looking at a live robot costs the workstation.

    python benchmarks/view.py

A robot that is none publishes 30 pictures/s as its camera sees them (320 x 240, JPEG), 10 as the
policy does, and 10 beats/s. Watched by `workstation view` and, as the alternative, by
`workstation telemetry --json`, one after the other; of a core, with the start taken away. What
Rerun's own viewer takes to draw is a program of its own and depends on the graphics card.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the robot that is none in tests/

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot_protocol.wire.keys import CAMERA
from tests.workstation.fake_robot import FakeRobot
from tests.workstation.samples import START_UNIX_NS, decision, picture

PICTURES_HZ, BEATS_HZ = 30, 10
SHORT_S = 3.0
"""Its costs are the start's."""

BAR_PERCENT = 25.0


def camera_picture(number: int) -> CompressedImage:
    """A frame with detail, another one each time."""
    noise = np.random.default_rng(number).integers(0, 255, (30, 40, 3), np.uint8)
    frame = cv2.resize(noise, (320, 240), interpolation=cv2.INTER_CUBIC)
    _, data = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, 80])
    made = CompressedImage(frame_id="camera", format="jpeg", data=data.tobytes())
    made.timestamp.FromNanoseconds(START_UNIX_NS + number * 10**9 // PICTURES_HZ)
    return made


def shown_a_second(data: bytes, seconds: float) -> float:
    """How many of the camera's pictures are in what the view wrote, by the bytes amid them."""
    middles = {(jpeg := camera_picture(n).data)[len(jpeg) // 2 :][:24] for n in range(PICTURES_HZ)}
    return sum(data.count(middle) for middle in middles) / seconds


def publish(robot: FakeRobot, stop: threading.Event) -> None:
    """Until told to stop."""
    frames = [camera_picture(number) for number in range(PICTURES_HZ)]
    number = 0
    while not stop.wait(1 / PICTURES_HZ):
        robot.publish(frames[number % len(frames)], CAMERA)
        if number % (PICTURES_HZ // BEATS_HZ) == 0:
            beat = decision(number)
            robot.publish(beat)
            robot.publish(picture(beat.unix_time_ns))
        number += 1


def cpu_s(command: Sequence[str], seconds: float) -> float:
    """Processor time of a command that ends by itself after so long, with all its threads."""
    before = os.times()
    subprocess.run([*command, "--seconds", str(seconds)], stdout=subprocess.DEVNULL, check=True)
    after = os.times()
    used = after.children_user + after.children_system
    return used - before.children_user - before.children_system


def percent_of_a_core(command: Sequence[str], seconds: float) -> float:
    """Of watching alone: a long look less a short one."""
    used_s = cpu_s(command, SHORT_S + seconds) - cpu_s(command, SHORT_S)
    return 100 * used_s / seconds


def main() -> int:
    """Print the figures; 1 if the bar is not kept."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=20.0, help="of watching, each")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    workstation = [sys.executable, "-m", "mbot_workstation.main"]
    stop = threading.Event()
    with FakeRobot() as robot, tempfile.TemporaryDirectory() as folder:
        publisher = threading.Thread(target=publish, args=(robot, stop), daemon=True)
        publisher.start()
        at = ["--robot", robot.address]
        live = Path(folder) / "live.rrd"
        saved = ["--save", str(live)]
        view = percent_of_a_core([*workstation, "view", *at, *saved], arguments.seconds)
        shown_hz = shown_a_second(live.read_bytes(), SHORT_S)
        telemetry = percent_of_a_core([*workstation, "telemetry", *at, "--json"], arguments.seconds)
        stop.set()
        publisher.join()
    figures = {
        "pictures_hz": round(shown_hz, 1),
        "view_percent": round(view, 1),
        "telemetry_percent": round(telemetry, 1),
        "ratio": round(view / max(telemetry, 0.1), 2),
    }
    print(json.dumps(figures) if arguments.json else figures)
    return int(view > BAR_PERCENT or shown_hz < 0.9 * PICTURES_HZ)


if __name__ == "__main__":
    sys.exit(main())
