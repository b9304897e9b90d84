"""The console's page in a real browser, between the real daemon and a person."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.models.key_folder import KeyFolder

from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .browser import CHROMIUM, browser, console
from .processes import Daemon, Process, until

FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)
BY_HAND_BOARD = (-130, 130)
"""40 % of both wheels, as the page begins."""

CONFIRMED_WITHIN_MS = 150
LET_GO_WITHIN_S = 1.0
HELD_S = 1.0
"""Longer than one word of the page keeps the robot driving."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="there is no Chromium: apt install chromium"),
]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture
def anna(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The key of the person who opens the console, as a robot is told to trust it."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "hers"))
    monkeypatch.chdir(tmp_path)
    return KeyFolder().new("anna").line


@pytest.fixture
def daemon(tmp_path: Path, board: FakeBoard, anna: str) -> Iterator[Daemon]:
    made = Daemon(tmp_path, board.path)
    made.config.write_text(made.config.read_text().replace('keys = ["', f'keys = ["{anna}", "'))
    with made.camera(), made.start():
        assert made.is_up()
        made.push(FORWARD)
        assert until(made.is_ready)
        yield made


@pytest.fixture
def served(daemon: Daemon, tmp_path: Path) -> Iterator[tuple[Process, str]]:
    with console(daemon.address, tmp_path / "console.log") as found:
        yield found


@pytest.fixture
def page(chromium: Browser, served: tuple[Process, str]) -> Iterator[Page]:
    opened = chromium.new_page()
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.goto(served[1])
    expect(opened.locator("#robot")).to_have_text("mbot-test")
    yield opened
    assert not errors
    if not opened.is_closed():
        opened.close()


def by_hand(board: FakeBoard) -> bool:
    """Whether it drives ahead, and not as the policy would."""
    left, right = board.speeds
    return left < 0 < right and board.speeds != FORWARD_BOARD


def stands(board: FakeBoard) -> bool:
    return board.speeds == (0, 0)


LONGEST = "http://camera-in-the-workshop/" + "x" * 300
"""Without a place to break it: an address, a file's name, an error."""

SCREENS = [(320, 568), (390, 844), (768, 1024), (812, 375), (1280, 720), (1920, 1080)]
"""CSS pixels: phones, a tablet, a phone on its side, desks."""

FILL = """text => {
  for (const id of ["robot", "state", "link", "headline", "stops", "said", "run-refused",
                    "hand-words", "model", "free", "verdict"])
    document.getElementById(id).textContent = text;
  for (const id of ["faults", "notices", "replay-lines"])
    document.getElementById(id).innerHTML = `<li>${text}</li>`.repeat(4);
  for (const id of ["facts", "models", "recordings"])
    document.getElementById(id).innerHTML = (
      `<tr><td>${text.slice(0, id === "facts" ? 18 : 300)}</td>` +
      `<td>${text}</td><td>p50 / p99 ${text}</td></tr>`).repeat(9);
  document.getElementById("replay").hidden = false;
}"""

IN_REACH = """() => {
  const stop = document.getElementById("stop"), box = stop.getBoundingClientRect();
  const text = document.createRange();
  text.selectNodeContents(stop.firstChild);
  const word = text.getBoundingClientRect();
  const hit = (x, y) => stop.contains(document.elementFromPoint(x, y));
  const inside = one => one.left >= 0 && one.top >= 0 && one.right <= innerWidth
    && one.bottom <= innerHeight;
  return {
    whole: inside(box) && box.left <= word.left && word.right <= box.right && box.top <= word.top
      && word.bottom <= box.bottom,
    hit: [.05, .5, .95].every(x => [.1, .5, .9].every(
      y => hit(box.left + x * box.width, box.top + y * box.height))),
    width: box.width, height: box.height,
  };
}"""

THUMB_PX = 44
"""WCAG 2.5.5, target size."""


@pytest.mark.parametrize("zoom", [1, 2])
def test_stop_is_whole_and_can_be_hit_on_every_screen_whatever_the_texts_are(
    page: Page, zoom: int
) -> None:
    sizes = [*SCREENS, *((height, width) for width, height in SCREENS[:2])]
    for width_px, height_px in sizes:
        # What a browser's zoom does to a page: fewer of its pixels on the same screen.
        page.set_viewport_size({"width": width_px // zoom, "height": height_px // zoom})
        for scrolled in ("0", "document.body.scrollHeight / 2", "document.body.scrollHeight"):
            page.evaluate(FILL, LONGEST)
            page.evaluate(f"scrollTo(0, {scrolled})")
            found = page.evaluate(IN_REACH)
            where = (width_px, height_px, scrolled, found)
            assert found["whole"], where
            assert found["hit"], where
            assert min(found["width"], found["height"]) * zoom >= THUMB_PX, where


def test_run_and_stop_from_the_page(page: Page, board: FakeBoard, daemon: Daemon) -> None:
    took_ms: list[int] = []
    for way in ("button", "space", "button"):
        expect(page.locator("#run")).to_be_enabled()
        page.click("#run")
        assert board.wait_for(*FORWARD_BOARD, timeout_s=10)
        page.locator("#stop").click() if way == "button" else page.keyboard.press("Space")
        expect(page.locator("#said")).to_contain_text("STOP: stopped, confirmed")
        assert stands(board)
        took_ms.append(int(page.locator("body").get_attribute("data-stop-ms") or -1))
    assert 0 < sorted(took_ms)[-2] < CONFIRMED_WITHIN_MS, took_ms
    expect(page.locator("#headline")).to_contain_text("Standing, stopped by")
    assert daemon.status().last_stop.count == 4


def test_run_is_shut_while_something_is_wrong_and_says_what(
    page: Page, board: FakeBoard, daemon: Daemon
) -> None:
    board.mute = True
    expect(page.locator("#faults")).to_contain_text("board", timeout=10_000)
    expect(page.locator("#run")).to_be_disabled()
    expect(page.locator("#run-refused")).to_contain_text("acknowledge")
    expect(page.locator("#stop")).to_be_enabled()


def seen_by_hand(page: Page, board: FakeBoard, key: str) -> bool:
    """Hold a key until it has driven for a second; again, as a person does, if the hand was lost.

    A page that does not come to its turn for 0.25 s has let go, rightly: on a busy machine it may.
    """
    for _ in range(5):
        page.keyboard.down(key)
        shown = until(lambda: by_hand(board) and page.text_content("#state") == "manual", 5)
        if shown and not until(lambda: not by_hand(board), HELD_S):
            return True
        page.keyboard.up(key)
    return False


def test_a_key_drives_while_it_is_held(page: Page, board: FakeBoard, daemon: Daemon) -> None:
    assert seen_by_hand(page, board, "KeyW")
    page.keyboard.up("KeyW")
    assert until(lambda: stands(board), LET_GO_WITHIN_S)
    expect(page.locator("#headline")).to_contain_text("Standing, the hand let go")
    assert until(lambda: not daemon.status().last_stop.by)
    assert daemon.status().last_stop.count == 1, "to let go is not a STOP"


def test_a_hand_takes_over_from_the_policy_and_does_not_give_back(
    page: Page, board: FakeBoard, daemon: Daemon
) -> None:
    page.click("#run")
    assert board.wait_for(*FORWARD_BOARD, timeout_s=10)
    page.locator("[data-way=ahead]").hover()
    page.mouse.down()
    assert until(lambda: by_hand(board), 5)
    page.mouse.up()
    assert until(lambda: stands(board), LET_GO_WITHIN_S)
    decisions = daemon.status().decisions
    assert until(lambda: daemon.status().decisions > decisions + 4)
    assert stands(board)


@pytest.mark.parametrize("end", ["closed", "killed", "blurred", "stopped"])
def test_however_the_page_is_lost_the_hands_drive_ends(
    page: Page, board: FakeBoard, daemon: Daemon, served: tuple[Process, str], end: str
) -> None:
    page.keyboard.down("ArrowUp")
    assert until(lambda: by_hand(board), 5)
    if end == "closed":
        page.close()
    elif end == "killed":
        served[0].signal(signal.SIGKILL)
    elif end == "blurred":
        page.locator("body").dispatch_event("blur")
        page.evaluate("() => dispatchEvent(new Event('blur'))")
    else:
        with daemon.link() as link:
            RemoteControl(link).stop()
    assert until(lambda: stands(board), LET_GO_WITHIN_S)
    decisions = daemon.status().decisions
    assert until(lambda: daemon.status().decisions > decisions + 3)
    assert stands(board), "although the key is held"


def test_a_model_is_sent_and_a_drive_decided_again(
    page: Page, board: FakeBoard, daemon: Daemon, tmp_path: Path
) -> None:
    other = tmp_path / "other.onnx"
    other.write_bytes(constant_model(-0.5, 0.25))
    refused = tmp_path / "refused.onnx"
    refused.write_bytes(b"no model")
    page.click("#run")
    assert board.wait_for(*FORWARD_BOARD, timeout_s=10)
    began = daemon.status().decisions
    assert until(lambda: daemon.status().decisions > began + 3)
    page.keyboard.press("Space")
    expect(page.locator("#said")).to_contain_text("STOP: stopped")

    def send(path: Path) -> None:
        with page.expect_file_chooser() as asked:
            page.click("#push-model")
        asked.value.set_files(path)
        expect(page.locator("#questions")).to_contain_text(f"Send {path.name} to mbot-test")
        page.click("#questions >> text=yes")

    send(refused)
    expect(page.locator("#said")).to_contain_text("refused.onnx: this is not an ONNX model")
    send(other)
    expect(page.locator("#said")).to_contain_text("is active", timeout=20_000)
    expect(page.locator("#models")).to_contain_text("active, on trial")
    assert daemon.status().active_model.signed_by == "anna"
    page.click("#list-recordings")
    page.click("#recordings >> text=fetch")
    expect(page.locator("#said")).to_contain_text("fetched into", timeout=20_000)
    with page.expect_file_chooser() as asked:
        page.click("#recordings >> text=by another model")
    asked.value.set_files(other)
    expect(page.locator("#replay-rows")).to_contain_text("-0.500 +0.250", timeout=20_000)
    expect(page.locator("#replay-lines")).to_contain_text("differ by more than 0.1")
    assert stands(board)


def test_pictures_of_both_eyes_are_drawn(page: Page) -> None:
    for canvas, width in (("#camera", "320"), ("#policy", "64")):
        expect(page.locator(canvas)).to_have_attribute("width", width)
    drawn = "(c) => c.getContext('2d').getImageData(0, 0, 8, 8).data.some((v, i) => i % 4 < 3 && v)"
    for canvas in ("#camera", "#policy"):
        assert until(lambda c=canvas: bool(page.locator(c).evaluate(drawn)), 10)


def test_the_consoles_own_end_is_seen_on_the_page(page: Page, served: tuple[Process, str]) -> None:
    served[0].signal(signal.SIGINT)
    assert served[0].wait() == 130
    assert "Traceback" not in served[0].output
    expect(page.locator("#link")).to_contain_text("no connection")
    expect(page.locator("#run")).to_be_disabled()
    page.keyboard.press("Space")
    expect(page.locator("#said")).to_contain_text("switch the robot off by hand")
