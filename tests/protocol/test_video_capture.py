from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.drive.video_capture import device_index, open_capture


@pytest.mark.parametrize(
    ("source", "index"),
    [("0", 0), ("/dev/video12", 12), ("film.mp4", None), ("http://robot/1", None), ("²", None)],
)
def test_devices_are_told_from_addresses_and_files(source: str, index: int | None) -> None:
    assert device_index(source) == index


def test_a_file_is_opened_and_one_that_is_not_there_is_not(tmp_path: Path) -> None:
    film = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for _ in range(3):
        writer.write(np.full((48, 64, 3), 90, np.uint8))
    writer.release()
    capture = open_capture(str(film), 1.0, 1.0)
    delivered, frame = capture.read()
    capture.release()
    assert delivered
    assert frame.shape == (48, 64, 3)
    assert not open_capture(str(tmp_path / "none.avi"), 1.0, 1.0).isOpened()
