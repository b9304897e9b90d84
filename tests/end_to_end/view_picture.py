"""A picture of Rerun's web viewer: `python -m tests.end_to_end.view_picture FILE.png`.

Twenty seconds of a virtual robot, the real daemon with the shipped policy, and a headless Chromium.
"""

import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.look.drives.live_view import follow
from mbot_workstation.look.drives.rerun_view import RerunView

from ..free_port import free_port
from .browser import CHROMIUM
from .console_pictures import PATH_NAME, driven_robot

WATCHED_S = 20.0
DRAWN_AFTER_MS = 75_000
"""WebGL without a graphics card."""

WEBGL = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def main() -> None:
    with RerunView(["mbot-test"], ["mbot-test"]) as viewer:
        page = viewer.serve_web(grpc_port=free_port(), web_port=free_port())
        with driven_robot() as daemon, daemon.link() as link:
            RemoteControl(link).run()
            follow(viewer, [link], {link.robot_id: daemon.directory / PATH_NAME}, WATCHED_S)
            RemoteControl(link).stop()
        draw(page, Path(sys.argv[1]))


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
