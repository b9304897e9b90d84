"""Pictures of the console for the documents: `python -m tests.end_to_end.console_pictures FOLDER`.

A virtual robot, the real daemon with the shipped policy, the console, and a headless Chromium.
"""

import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import expect

from mbot_workstation.fleet.models.push import push

from .browser import browser, console
from .processes import Daemon, until, workstation

MODEL = Path(__file__).parents[2] / "models" / "red-cube.onnx"
DESKTOP, PHONE = (1200, 820), (390, 844)
STARTS_WITHIN_S = 60
PATH_NAME = "path.jsonl"


@contextmanager
def driven_robot() -> Iterator[Daemon]:
    """A virtual robot and its daemon, ready to drive with the shipped policy."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        daemon = Daemon(folder, str(folder / "board"))
        arguments = ("virtual-robot", "--board", str(folder / "board"))
        camera = ("--camera-port", str(daemon.camera_port))
        path = ("--trajectory", str(folder / PATH_NAME))
        with workstation(*arguments, *camera, *path, log=folder / "robot.log") as robot:
            assert until(lambda: "ready" in robot.output, STARTS_WITHIN_S), robot.output
            with daemon.start():
                assert daemon.is_up()
                with daemon.link() as link:
                    push(link, MODEL, lambda _: daemon.key)
                assert until(daemon.is_ready)
                yield daemon


def main() -> None:
    with (
        driven_robot() as daemon,
        console(daemon.address, daemon.directory / "console.log") as (_, address),
    ):
        draw(address, Path(sys.argv[1]))


def draw(address: str, into: Path) -> None:
    with browser() as chromium:
        page = chromium.new_page()
        for name, (width_px, height_px) in (("console", DESKTOP), ("console-phone", PHONE)):
            page.set_viewport_size({"width": width_px, "height": height_px})
            page.goto(address)
            page.click("#list-models")
            page.click("#run")
            expect(page.locator("#state")).to_have_text("running")
            expect(page.locator("#recordings")).to_be_attached()
            page.wait_for_timeout(2500)
            page.click("#list-recordings")
            expect(page.locator("#recordings")).to_contain_text("drive-")
            page.evaluate("() => scrollTo(0, 0)")
            page.screenshot(path=into / f"{name}.png")
            page.keyboard.press("Space")
            expect(page.locator("#said")).to_contain_text("STOP: stopped")


if __name__ == "__main__":
    main()
