"""What is asked of a picture, and how much of it; test_camera.py has whole streams of them."""

import time

import numpy as np
import pytest

from mbot_agent.camera.picture_check import BLACK_BELOW, PictureCheck, RecentPictures, is_black
from mbot_agent.configuration import CameraSettings

from .camera_bench import MILLISECOND, noise


def test_of_a_new_picture_every_sixteenth_row_is_all_that_is_hashed() -> None:
    """So that the first one with these rows may be the same as the second: in doubt it is."""
    recent = RecentPictures()
    alike = [noise(number) for number in range(3)]
    for picture in alike:
        picture[::16] = alike[0][::16]
    assert [recent.has(picture) for picture in alike] == [False, True, False]
    assert [recent.has(picture) for picture in alike] == [False, True, True]


def test_every_eighth_pixel_tells_whether_a_picture_is_black() -> None:
    picture = np.full((48, 64, 3), 255, np.uint8)
    picture[::8, ::8] = 0
    assert is_black(picture)
    assert not is_black(255 - picture)


def test_black_is_below_the_bar_not_at_it() -> None:
    for level, black in ((BLACK_BELOW - 1, True), (BLACK_BELOW, False)):
        assert is_black(np.full((48, 64, 3), level, np.uint8)) == black


@pytest.mark.parametrize(
    ("source", "mend", "other"),
    [("/dev/video0", "refuse-while-driving", "stuck"), ("clip.mp4", "stuck", "driving")],
)
def test_a_frozen_picture_says_what_may_be_done(
    source: str, mend: str, other: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that cannot move is no reason for a sensor without any noise."""
    check = PictureCheck(CameraSettings(source=source))
    monkeypatch.setattr(time, "monotonic_ns", lambda: 0)
    check.drives(driving=True)
    faults = [check.judge(noise(0), at_ms * MILLISECOND) for at_ms in (0, 2000)]
    assert faults[0] is None
    assert faults[1] is not None
    assert mend in faults[1].detail
    assert other not in faults[1].detail
