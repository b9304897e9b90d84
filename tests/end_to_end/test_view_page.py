"""Rerun's web viewer in a real browser: it draws what it is given, and what comes afterwards."""

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page, sync_playwright

from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.drive.picture import Picture
from mbot_workstation.look.drives.driven_path import Place
from mbot_workstation.look.drives.rerun_view import RerunView

from ..free_port import free_port
from .browser import CHROMIUM
from .view_picture import WEBGL

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"
DRAWN_WITHIN_S = 90
"""WebGL without a graphics card."""

COLOURS = 200
"""A page without a drive in it has a few dozen."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not CHROMIUM, reason="there is no Chromium: apt install chromium"),
]


@pytest.fixture
def page() -> Iterator[Page]:
    with sync_playwright() as play:
        chromium = play.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--ignore-gpu-blocklist", *WEBGL]
        )
        yield chromium.new_page(viewport={"width": 800, "height": 500})
        chromium.close()


def seen(page: Page) -> Picture:
    """The page now, shape (500, 800, 3)."""
    png = np.frombuffer(page.screenshot(timeout=60_000), np.uint8)
    return np.asarray(cv2.imdecode(png, cv2.IMREAD_COLOR), np.uint8)


def colours(shot: Picture) -> int:
    return len(np.unique(shot.reshape(-1, 3), axis=0))


def watch(page: Page, is_there: Callable[[Picture], bool], what: str) -> Picture:
    """What is seen as soon as that is there."""
    for _ in range(DRAWN_WITHIN_S):
        if is_there(shot := seen(page)):
            if folder := os.environ.get("MBOT_SHOW_PAGE"):
                cv2.imwrite(str(Path(folder) / f"{what}.png"), shot)
            return shot
        page.wait_for_timeout(1000)
    raise AssertionError(f"{what}: not seen; {colours(seen(page))} colours")


def red(shot: Picture) -> int:
    """How many pixels have the object's colour on the map."""
    blue, green, reddish = (shot[..., n].astype(int) for n in range(3))
    return int(((reddish > 180) & (green < 90) & (blue < 90)).sum())


def later(drive: RecordedDrive, by_s: float) -> RecordedDrive:
    """The same drive, afterwards."""
    for beat in drive.beats:
        beat.decision.unix_time_ns += round(by_s * 1e9)
    return replace(drive, beats=drive.beats)


def test_a_drive_is_drawn_and_what_follows_as_well(page: Page) -> None:
    drive = read_drive(RECORDED)
    with RerunView(["virtual"], ["virtual"]) as viewer:
        address = viewer.serve_web(grpc_port=free_port(), web_port=free_port())
        page.goto(address)
        empty = colours(seen(page))
        viewer.log_drive(drive)
        first = watch(page, lambda shot: colours(shot) > max(COLOURS, 2 * empty), "drawn")
        assert red(first) < 20
        viewer.log_drive(later(drive, 6.0))
        end_ns = drive.beats[-1].decision.unix_time_ns
        viewer.log_place("virtual", Place(end_ns, (0.0, 0.0), 0.0, (0.3, 0.2)))
        viewer.log_path("virtual", end_ns, [[(-0.5, -0.5), (0.0, -0.3), (0.0, 0.0)]])
        then = watch(page, lambda shot: red(shot) > 20, "map")
        assert (np.abs(then.astype(int) - first).max(axis=-1) > 40).mean() > 0.01
