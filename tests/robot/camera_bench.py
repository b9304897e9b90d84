"""Cameras by hand: frames that come one at a time, when a test says so."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, cast

import numpy as np
import pytest

from mbot_agent.camera import capture as capture_module
from mbot_agent.camera.capture import CaptureThread
from mbot_agent.camera.source_contract import CameraError, FrameSource, JpegError, Shot
from mbot_agent.configuration import CameraSettings

MILLISECOND = 1_000_000


def noise(seed: int, height_px: int = 48, width_px: int = 64) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height_px, width_px, 3), np.uint8)


class Encoded:
    """A camera whose pictures have to be decoded, with frames at even times of its own.

    Attributes:
        every_ms: the time between them.
        now_ns: the newest one's.
        decoded: numbers of those whose picture was asked for.

    """

    def __init__(self, **settings: Any) -> None:
        self.capture = CaptureThread(CameraSettings(source="http://camera/stream", **settings))
        self.every_ms = 33
        self.now_ns = 100 * 33 * MILLISECOND
        self.decoded: list[int] = []
        self._shots: list[Shot] = []
        self._frames = 0

    def read(self) -> Shot:
        return self._shots.pop()

    def sends(self, picture: np.ndarray | None = None, *, shape: tuple[int, ...] = ()) -> None:
        """One frame, of noise if no picture is given; damaged if it is an empty one."""
        number = self._frames
        self._frames += 1
        self.now_ns += self.every_ms * MILLISECOND
        shown = noise(number) if picture is None else picture

        def decode() -> np.ndarray:
            self.decoded.append(number)
            if not shown.size:
                raise JpegError("it cannot be decoded")
            return shown

        shot = Shot(shape or (48, 64, 3), self.now_ns, decode)
        self._shots.append(shot)
        self.capture._take(cast(FrameSource, self))  # pyright: ignore[reportPrivateUsage]

    @property
    def fault(self) -> str | None:
        found = self.capture.fault
        return found.kind if found is not None and found.kind != "camera-stalled" else None


class Pauses(threading.Event):
    """Those that a thread makes until it is told to end: written down, and over at once."""

    def __init__(self) -> None:
        super().__init__()
        self.lengths_s: list[float | None] = []

    def wait(self, timeout: float | None = None) -> bool:
        self.lengths_s.append(timeout)
        return self.is_set()


class Handed:
    """A camera that delivers what it is handed, to a thread that runs."""

    def __init__(self) -> None:
        self.pauses = Pauses()
        self._given: SimpleQueue[Shot | None] = SimpleQueue()
        self._asked = threading.Semaphore(0)

    def __enter__(self) -> "Handed":
        return self

    def __exit__(self, *_: object) -> None: ...

    def hold_light(self, held: bool) -> bool:
        return False

    def read(self) -> Shot:
        self._asked.release()
        shot = self._given.get()
        if shot is None:
            raise CameraError("the cable was pulled")
        return shot

    def give(self, shot: Shot | None) -> None:
        """One frame, or a cable that is pulled; until the thread is done with it."""
        self._given.put(shot)
        self.wait_until_asked()

    def wait_until_asked(self) -> None:
        assert self._asked.acquire(timeout=5)

    def end(self) -> None:
        self.pauses.set()
        self._given.put(None)


@contextmanager
def handed(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[CaptureThread, Handed]]:
    """A capture thread, and the camera it has opened."""
    camera, capture = Handed(), CaptureThread(CameraSettings(source="0"))
    monkeypatch.setattr(capture_module, "frame_source", lambda _: camera)
    monkeypatch.setattr(capture, "_closing", camera.pauses)
    with capture:
        try:
            camera.wait_until_asked()
            yield capture, camera
        finally:
            camera.end()
