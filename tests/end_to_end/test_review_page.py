"""The page of all fetched drives in a real browser, on a desk and on a phone."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Page
from typer.testing import CliRunner

from mbot_workstation.cli.subcommands import app

from ..workstation.fake_robot import FakeRobot
from ..workstation.hand_driven import hand_driven
from .browser import CHROMIUM, browser, console

pytestmark = [
    pytest.mark.skipif(not CHROMIUM, reason="no Chromium on this machine"),
    pytest.mark.slow,
]

SIZES = {"desktop": (1280, 900), "phone": (390, 844)}


@pytest.fixture
def page_file(tmp_path: Path) -> Path:
    for number in range(3):
        hand_driven(tmp_path / "drives" / "mbot-1" / f"drive-{number:04d}", seed=number + 1)
    result = CliRunner().invoke(
        app, ["drives", "review", str(tmp_path / "drives"), "-o", str(tmp_path / "review.html")]
    )
    assert result.exit_code == 0, result.exception
    return tmp_path / "review.html"


def said(page: Page) -> list[str]:
    return page.input_value("#commands").splitlines()


def test_on_the_console_a_click_is_written_at_once(
    page_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(page_file.parent)  # where the console looks for drives
    log = page_file.parent / "console.log"
    with FakeRobot() as robot, console(robot.address, log) as (_, address), browser() as chromium:
        page = chromium.new_page(viewport={"width": 390, "height": 844})
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("console", lambda message: problems.append(message.text))
        page.goto(address + "drives")
        drive = page.locator("section").nth(1)
        drive.locator(".verdict[data-word=drop]").click()
        page.get_by_text("drive-0001: drop").wait_for()
        drive.locator('.strip:not(.six) [data-beat="204"] .eye').click()
        page.get_by_text("beat 204 labelled").wait_for()
        assert (
            drive.locator('.strip:not(.six) [data-beat="204"] circle').get_attribute("cx") != "-9"
        )
        assert not problems, "its own script and style may run, and nothing was refused"
    review = json.loads((page_file.parent / "drives/mbot-1/drive-0001.review.json").read_text())
    assert review["verdict"] == "drop"
    assert review["labels"]["204"]["x"] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("size", SIZES)
def test_a_click_says_what_is_typed_then(page_file: Path, size: str) -> None:
    width, height = SIZES[size]
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": width, "height": height})
        asked: list[str] = []
        problems: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(page_file.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= width, "nothing overflows"
        drive = page.locator("section").first
        drive.locator(".verdict[data-word=keep]").click()
        box = drive.locator('.strip:not(.six) [data-beat="104"] img').bounding_box()
        assert box is not None
        drive.locator('.strip:not(.six) [data-beat="104"] .eye').click(
            position={"x": box["width"] * 0.25, "y": box["height"] * 0.75}
        )
        drive.locator('.strip:not(.six) [data-beat="105"] .none').click()
        drive.locator('.strip:not(.six) [data-beat="104"] .eye').focus()
        page.keyboard.press("Enter")  # has no place, and labels nothing
        commands = said(page)
        assert not problems
        assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    assert len(commands) == 3
    for command in commands:
        result = CliRunner().invoke(app, command.split()[1:])
        assert result.exit_code == 0, (command, result.exception)
    review = json.loads((page_file.parent / "drives/mbot-1/drive-0000.review.json").read_text())
    assert review["verdict"] == "keep"
    assert review["labels"]["105"] is None
    assert review["labels"]["104"]["x"] == pytest.approx(0.25, abs=0.03)
    assert review["labels"]["104"]["y"] == pytest.approx(0.75, abs=0.03)
