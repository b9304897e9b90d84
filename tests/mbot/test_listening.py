"""Beats, pictures and recordings as they come, and when none do."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot import ConfigurationError, Robot, UnreachableError, listening, read_recording
from mbot_protocol.wire.keys import CAMERA

from ..workstation.fake_robot import FakeRobot
from ..workstation.samples import decision


def picture(sequence: int, shape: tuple[int, int], colour: tuple[int, int, int]) -> CompressedImage:
    bgr = np.full((*shape, 3), colour[::-1], np.uint8)
    message = CompressedImage(format="png", data=cv2.imencode(".png", bgr)[1].tobytes())
    message.timestamp.FromNanoseconds(decision(sequence).unix_time_ns)
    return message


@contextmanager
def telling(fake: FakeRobot, *, pictures: bool = True) -> Iterator[None]:
    """Ten beats a second, each with what it saw; its red counts up."""
    stop = threading.Event()

    def tell() -> None:
        sequence = 0
        while not stop.wait(0.1):
            fake.publish(decision(sequence))
            if pictures:
                fake.publish(picture(sequence, (64, 64), (sequence, 0, 9)))
                fake.publish(picture(sequence, (48, 64), (0, 200, 0)), CAMERA)
            sequence += 1

    thread = threading.Thread(target=tell)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_every_beat_comes_once_with_what_it_saw(fake: FakeRobot) -> None:
    with telling(fake), Robot(fake.address) as robot:
        beats = list(robot.beats(seconds=1.0))
    numbers = [beat.number for beat in beats]
    assert len(numbers) > 5
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    for beat in beats[:-1]:
        assert beat.frame is not None
        assert tuple(beat.frame[0, 0]) == (beat.number, 0, 9)


def test_beats_come_without_pictures_too(fake: FakeRobot) -> None:
    with telling(fake, pictures=False), Robot(fake.address) as robot:
        beats = list(robot.beats(seconds=1.0))
    assert len(beats) > 5
    assert all(beat.frame is None for beat in beats)


def test_frames_are_what_the_policy_or_the_camera_sees(fake: FakeRobot) -> None:
    with telling(fake), Robot(fake.address) as robot:
        narrow = next(robot.frames())
        wide = next(robot.frames(wide=True))
        assert (narrow.shape, narrow.dtype, narrow[0, 0, 2]) == ((64, 64, 3), np.uint8, 9)
        assert (wide.shape, tuple(wide[0, 0])) == ((48, 64, 3), (0, 200, 0))


def test_who_is_slow_gets_the_newest_frame(fake: FakeRobot) -> None:
    with telling(fake), Robot(fake.address) as robot:
        frames = robot.frames()
        first = int(next(frames)[0, 0, 0])
        time.sleep(1.0)
        assert int(next(frames)[0, 0, 0]) - first >= 5


def test_silence_is_an_error_and_so_is_a_robot_without_eyes(
    fake: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listening, "PATIENCE_S", 0.5)
    with Robot(fake.address) as robot:
        with pytest.raises(UnreachableError, match=r"mbot-1 at tcp/.*no telemetry since"):
            list(robot.beats())
        with telling(fake, pictures=False), pytest.raises(UnreachableError, match="no pictures"):
            list(robot.frames())


def test_after_its_block_a_robot_says_nothing(fake: FakeRobot) -> None:
    with telling(fake):
        with Robot(fake.address) as robot:
            beats = robot.beats()
            next(beats)
        with pytest.raises(UnreachableError, match="has ended"):
            list(beats)


def test_a_recording_holds_what_came_during_its_block(fake: FakeRobot, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with telling(fake), Robot(fake.address) as robot:
        with robot.record(path):
            heard = [beat.number for beat in robot.beats(seconds=1.0)]
        with pytest.raises(ConfigurationError, match="exists already"), robot.record(str(path)):
            pass
    recorded = list(read_recording(path))
    assert {beat.number for beat in recorded} >= set(heard[:-2])
    assert sum(beat.frame is not None for beat in recorded) > 5


def test_what_its_block_raises_closes_a_recording(fake: FakeRobot, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"

    def fail() -> None:
        with telling(fake), Robot(fake.address) as robot, robot.record(path):
            next(robot.beats())
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert list(read_recording(path))
