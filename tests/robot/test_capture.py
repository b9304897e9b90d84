"""What the capture thread makes of single frames; test_camera.py has it with whole cameras."""

import time

import numpy as np
import pytest

from mbot_agent.camera.capture import CaptureThread
from mbot_agent.camera.source_contract import Shot
from mbot_protocol.back_off import BackOff

from .camera_bench import MILLISECOND, Encoded, handed, noise

DAMAGED = np.zeros(0, np.uint8)


def seen_ns(capture: CaptureThread) -> int | None:
    frame = capture.latest()
    return None if frame is None else frame.captured_ns


def test_the_first_frame_after_opening_is_dropped_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A server's newest picture may be of long ago, whatever its time says."""
    with handed(monkeypatch) as (capture, camera):
        for opening in range(3):
            before_ns = seen_ns(capture)
            first, second = (
                Shot.decoded(noise(2 * opening + k), time.monotonic_ns()) for k in range(2)
            )
            camera.give(first)
            assert seen_ns(capture) == before_ns
            assert opening or not capture.is_fresh()
            camera.give(second)
            assert seen_ns(capture) == second.captured_ns
            camera.give(None)


def test_a_lost_camera_is_tried_ever_more_rarely_and_soon_once_it_has_worked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    back_off = BackOff()
    longer_s = [back_off.next_s() for _ in range(3)]
    with handed(monkeypatch) as (_, camera):
        for _ in longer_s:
            camera.give(None)
        assert camera.pauses.lengths_s == longer_s
        for number in range(2):
            camera.give(Shot.decoded(noise(number), time.monotonic_ns()))
        camera.give(None)
        assert camera.pauses.lengths_s == [*longer_s, longer_s[0]]


def test_people_see_the_newest_frame_and_none_that_is_damaged() -> None:
    camera = Encoded()
    assert camera.capture.glance() is None
    camera.sends()
    picture = camera.capture.glance()
    assert picture is not None
    assert np.array_equal(picture, noise(0))
    camera.sends(DAMAGED)
    assert camera.decoded == [0]
    assert camera.capture.glance() is None


def test_a_still_picture_is_refused_once_it_drives_and_believed_again_once_forgiven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    camera, still = Encoded(identical_frames="refuse-while-driving"), noise(7)
    monkeypatch.setattr(time, "monotonic_ns", lambda: camera.now_ns)
    for _ in range(40):
        camera.sends(still)
    assert camera.fault is None
    for _ in range(40):
        camera.capture.drives(True)  # as each decision says
        camera.sends(still)
    assert camera.fault == "camera-frozen"
    camera.capture.drives(False)
    for _ in range(4):
        camera.sends(still)
    assert camera.fault == "camera-frozen"
    camera.capture.forgive()
    camera.sends(still)
    assert camera.fault is None


def test_after_a_bad_picture_each_one_is_looked_at_until_one_is_good() -> None:
    camera = Encoded()
    for picture in (None, None, None, None, DAMAGED, DAMAGED):
        camera.sends(picture)
    assert camera.fault == "camera-damaged"
    for _ in range(2):
        camera.sends()
    assert camera.fault is None
    assert camera.decoded == [0, 4, 5, 6]


def test_a_picture_is_looked_at_at_least_every_100_ms() -> None:
    camera = Encoded()
    camera.every_ms = 50
    for _ in range(7):
        camera.sends()
    assert camera.decoded == [0, 2, 4, 6]


def test_the_interval_is_a_mean_in_which_one_late_frame_counts_little() -> None:
    camera = Encoded()
    for _ in range(5):
        camera.sends()
    camera.every_ms = 65
    camera.sends()
    assert camera.capture.interval_ns == 34 * MILLISECOND  # 33 and a thirty-second of 32 more
