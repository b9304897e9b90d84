"""What a robot tells while it drives: beats, pictures, and a recording of both."""

import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import zenoh
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot.beat import Beat
from mbot_protocol.beat import beat as protocol
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import MbotError, UnreachableError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.telemetry.stream import LinkState, Sample, TelemetryStream
from mbot_workstation.fleet.telemetry.view import link_words
from mbot_workstation.fleet.telemetry.watch import watch

PATIENCE_S = 10.0
"""Silence that is an error. The slowest robot decides every 2 s; a restart takes some seconds."""

POLL_S = 0.1


def beats(link: RobotLink, seconds: float | None) -> Iterator[Beat]:
    """Every beat, with its picture if the robot sends any. Raises as `_samples`."""
    waiting: Decision | None = None
    picture = CompressedImage()
    for samples in _samples(link, seconds):
        for message in (one.message for one in samples):
            if isinstance(message, CompressedImage):
                picture = message
            else:
                if waiting is not None:
                    yield _beat(waiting, None)
                waiting = message
            if waiting is not None and picture.timestamp.ToNanoseconds() == waiting.unix_time_ns:
                yield _beat(waiting, picture)
                waiting = None
        if not samples and waiting is not None:  # it follows its beat within milliseconds, or never
            yield _beat(waiting, None)
            waiting = None


def frames(link: RobotLink, seconds: float | None, *, wide: bool) -> Iterator[Picture]:
    """The newest picture, again and again; who is slow misses some.

    Raises:
        UnreachableError: as `_samples`, or there are beats and no pictures.

    """
    from mbot_workstation.pictures.picture_file import decode_picture

    came_s = time.monotonic()
    for samples in _samples(link, seconds, camera=wide):
        pictures = [
            one.message.data
            for one in samples
            if isinstance(one.message, CompressedImage) and one.of_camera == wide
        ]
        if pictures and (picture := decode_picture(pictures[-1])) is not None:
            yield picture
            came_s = time.monotonic()
        elif time.monotonic() - came_s > PATIENCE_S:
            raise UnreachableError(
                f"robot {link.robot_id} sends no pictures: has it a camera, and what does "
                "[telemetry] pictures in its configuration say?"
            )


@contextmanager
def recorded(link: RobotLink, path: Path) -> Generator[None]:
    """Record into a new MCAP file, as `workstation telemetry --record`, until the block ends.

    Raises:
        ConfigurationError: the file is there already, or can't be written, perhaps at the end only.
        UnreachableError: the robot doesn't answer.

    """
    watched = watch(link, _Nowhere(), path, None)
    next(watched)  # opens the file and listens, or raises
    closing = threading.Event()
    problems: list[MbotError] = []

    def go_on() -> None:
        try:
            while not closing.is_set():
                next(watched)
        except MbotError as error:
            problems.append(error)

    thread = threading.Thread(target=go_on, name="recording", daemon=True)
    thread.start()
    try:
        yield
    finally:
        closing.set()
        thread.join()
        watched.close()
    if problems:
        raise problems[0]


class _Nowhere:
    """An output that shows nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def take(self, sample: Sample) -> None:
        """Nothing."""

    def refresh(self, link: LinkState, silence_s: float) -> None:
        """Nothing."""


def _samples(
    link: RobotLink, seconds: float | None, *, camera: bool = False
) -> Iterator[list[Sample]]:
    """What has come, every 0.1 s or as it comes.

    Raises:
        UnreachableError: nothing for 10 s, or the robot's `with` has ended.
        NewerSchemaError: the robot speaks a newer schema.

    """
    until_s = None if seconds is None else time.monotonic() + seconds
    name = f"robot {link.robot_id} at {link.endpoint}"
    with TelemetryStream(link, link.status().decision_rate_hz, camera=camera) as stream:
        while until_s is None or time.monotonic() < until_s:
            try:
                samples = stream.poll(POLL_S)
            except zenoh.ZError:  # of a session that is closed
                raise UnreachableError(f"{name}: the block of its `with` has ended") from None
            yield samples
            if stream.silence_s > PATIENCE_S:
                raise UnreachableError(f"{name}: {link_words(stream.state, stream.silence_s)}")


def _beat(decision: Decision, picture: CompressedImage | None) -> Beat:
    return Beat(protocol.Beat(decision, encoded=picture.data if picture is not None else b""))
