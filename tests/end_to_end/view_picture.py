"""A picture of Rerun's web viewer: `python -m tests.end_to_end.view_picture FILE.png`.

Ten seconds of a virtual robot, the real daemon with the shipped policy, and a headless Chromium.
"""

import sys
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.drives.rerun_view import RerunView
from mbot_workstation.link.remote_control import RemoteControl
from mbot_workstation.link.robot_link import RobotLink
from mbot_workstation.telemetry.stream import TelemetryStream

from .browser import CHROMIUM
from .console_pictures import driven_robot
from .processes import free_port

WATCHED_S = 10.0
DRAWN_AFTER_MS = 30_000
"""WebGL without a graphics card."""

WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def main() -> None:
    with RerunView(["mbot-test"]) as viewer:
        page = viewer.serve_web(grpc_port=free_port(), web_port=free_port())
        with driven_robot() as daemon, daemon.link() as link:
            RemoteControl(link).run()
            follow(viewer, link)
            RemoteControl(link).stop()
        draw(page, Path(sys.argv[1]))


def follow(viewer: RerunView, link: RobotLink) -> None:
    until_s = time.monotonic() + WATCHED_S
    with TelemetryStream(link, camera=True) as stream:
        while time.monotonic() < until_s:
            for sample in stream.poll(0.1):
                message = sample.message
                if isinstance(message, Decision):
                    viewer.log_decision(message)
                else:
                    time_ns, camera = message.timestamp.ToNanoseconds(), sample.of_camera
                    viewer.log_picture(
                        link.robot_id, message.data, time_ns, exact=False, of_camera=camera
                    )


def draw(address: str, into: Path) -> None:
    with sync_playwright() as play:
        chromium = play.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--ignore-gpu-blocklist", *WEBGL]
        )
        page = chromium.new_page(viewport={"width": 1200, "height": 700})
        page.goto(address)
        page.wait_for_timeout(DRAWN_AFTER_MS)
        page.screenshot(path=into, timeout=60_000)
        chromium.close()


if __name__ == "__main__":
    main()
