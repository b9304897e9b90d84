"""When a camera's automatics are held, by the rules and through the capture thread."""

from typing import cast

import numpy as np
import pytest

from mbot_agent.camera.automatics import SETTLES_NS, STANDS_AFTER_NS, Automatics
from mbot_agent.camera.capture import CaptureThread
from mbot_agent.camera.source_contract import FrameSource, Shot
from mbot_agent.configuration import CameraSettings

SECOND = 1_000_000_000


def test_they_settle_while_it_stands_and_are_held_while_it_drives() -> None:
    rules = Automatics("settle")
    rules.opened(0)
    assert not rules.held(10 * SECOND)
    rules.drives(True, 10 * SECOND)
    assert rules.held(10 * SECOND)
    rules.drives(False, 10 * SECOND + 400_000_000)  # one decision was held
    assert rules.held(10 * SECOND + 400_000_000)
    assert not rules.held(10 * SECOND + STANDS_AFTER_NS)


def test_a_camera_opened_in_mid_drive_settles_first() -> None:
    rules = Automatics("settle")
    rules.opened(0)
    for tenth in range(30):
        rules.drives(True, tenth * SECOND // 10)
        assert rules.held(tenth * SECOND // 10) == (tenth * SECOND // 10 >= SETTLES_NS)
    rules.opened(3 * SECOND)  # it was lost, and is back
    rules.drives(True, 3 * SECOND + 1)
    assert not rules.held(3 * SECOND + 1)


@pytest.mark.parametrize(("setting", "held"), [("always", False), ("off", True)])
def test_the_other_settings_do_not_ask_whether_it_drives(setting: str, held: bool) -> None:
    rules = Automatics(setting)  # pyright: ignore[reportArgumentType]
    rules.opened(0)
    assert not rules.held(SETTLES_NS - 1)
    assert rules.held(SETTLES_NS) is held
    rules.drives(True, 5 * SECOND)
    assert rules.held(5 * SECOND) is held


class Adjustable:
    """A camera whose light can be held, or refuses from some time on."""

    def __init__(self) -> None:
        self.orders: list[bool] = []
        self.can = True
        self.now_ns = 0

    def __enter__(self) -> "Adjustable":
        return self

    def __exit__(self, *_: object) -> None: ...

    def read(self) -> Shot:
        picture = np.random.default_rng(self.now_ns).integers(0, 255, (48, 64, 3), np.uint8)
        return Shot.decoded(picture, self.now_ns)

    def hold_light(self, held: bool) -> bool:
        self.orders.append(held)
        return self.can


def frames(
    capture: CaptureThread, source: Adjustable, until_s: float, *, driving: bool = False
) -> None:
    while source.now_ns < until_s * SECOND:
        source.now_ns += SECOND // 30
        if driving:
            capture.drives(True)
        capture._take(cast(FrameSource, source))


def test_the_thread_says_it_once_and_tells_what_is_so(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Adjustable()
    monkeypatch.setattr("time.monotonic_ns", lambda: source.now_ns)
    capture = CaptureThread(CameraSettings())
    assert capture.light == "unknown"
    capture._begin(cast(FrameSource, source))
    frames(capture, source, 3)
    assert capture.light == "automatic"
    capture.drives(True)
    frames(capture, source, 3.5)
    assert capture.light == "held"
    frames(capture, source, 6)
    assert capture.light == "automatic"
    assert source.orders == [False, True, False]
    source.can = False
    capture.drives(True)
    frames(capture, source, 6.5)
    assert (capture.light, source.orders[3:]) == ("unknown", [True])  # and never asked again


def test_a_camera_that_is_reopened_in_mid_drive_settles_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    source = Adjustable()
    monkeypatch.setattr("time.monotonic_ns", lambda: source.now_ns)
    capture = CaptureThread(CameraSettings())
    for opened_s in (0, 5):
        capture._begin(cast(FrameSource, source))
        frames(capture, source, opened_s + SETTLES_NS / SECOND - 0.1, driving=True)
        assert capture.light == "automatic"
        frames(capture, source, opened_s + 5, driving=True)
        assert capture.light == "held"


def test_a_camera_whose_light_cannot_be_held_is_asked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    source = Adjustable()
    source.can = False
    monkeypatch.setattr("time.monotonic_ns", lambda: source.now_ns)
    capture = CaptureThread(CameraSettings())
    capture._begin(cast(FrameSource, source))
    assert capture.light == "unknown"
    frames(capture, source, 5, driving=True)
    assert (capture.light, source.orders) == ("unknown", [False])
