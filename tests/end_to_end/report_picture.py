"""A picture of a drive's report: `python -m tests.end_to_end.report_picture FILE.png`.

Half a minute of a virtual robot and the real daemon with the shipped policy, fetched from its card.
"""

import sys
import time
from pathlib import Path

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_workstation.fleet.link.recording_fetch import fetch, list_recordings
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.look.drives.attention import attention
from mbot_workstation.look.drives.drive_figures import figures
from mbot_workstation.look.drives.drive_page import STRIP_TILES, drive_page
from mbot_workstation.look.drives.driven_path import read_path
from mbot_workstation.look.drives.replayed_drive import models_near

from .browser import browser
from .console_pictures import PATH_NAME, driven_robot
from .processes import until

CHECKOUT = Path(__file__).parents[2]
DRIVEN_S = 28.0
RECORDED_AFTERWARDS_S = 5.0
WIDTH_PX, HEIGHT_PX = 1000, 900


def main() -> None:
    with driven_robot() as daemon, daemon.link() as link:
        control = RemoteControl(link)
        control.run()
        time.sleep(DRIVEN_S)
        control.stop()
        assert until(lambda: not list_recordings(link).drives[0].open, 2 * RECORDED_AFTERWARDS_S)
        folder = fetch(link, list_recordings(link).drives[0], daemon.directory)
        places = read_path(daemon.directory / PATH_NAME)
        page = daemon.directory / "drive.html"
        drive = figures(read_drive(folder))
        looks, _ = attention(drive.chosen(STRIP_TILES), models_near(CHECKOUT))
        page.write_text(drive_page([drive], places, [looks]))
        draw(page, Path(sys.argv[1]))


def draw(page: Path, into: Path) -> None:
    with browser() as chromium:
        opened = chromium.new_page(viewport={"width": WIDTH_PX, "height": HEIGHT_PX})
        opened.goto(page.as_uri())
        opened.screenshot(path=into, full_page=True)


if __name__ == "__main__":
    main()
