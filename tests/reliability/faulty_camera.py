"""A camera on the network that can stall, die, go black, freeze and change its shape."""

import threading
import time
from typing import Literal, Self

import cv2
import numpy as np

from mbot_workstation.virtual.mjpeg_server import MjpegServer

Mood = Literal["good", "silent", "black", "frozen", "wrong-shape"]

FRAME_S = 1 / 30
WIDTH_PX, HEIGHT_PX = 320, 240
PICTURES = 37
"""More than a stuck camera has in turn; not 36: every decision, 0.4 s after the last one, would
find one of the same three."""


def _jpeg(picture: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", picture)[1].tobytes()


def _noise(seed: int, height_px: int, width_px: int) -> np.ndarray:
    blocks = (height_px // 4, width_px // 4, 3)
    small = np.random.default_rng(seed).integers(0, 256, blocks, np.uint8)
    return small.repeat(4, 0).repeat(4, 1)


class FaultyCamera:
    """30 pictures a second over HTTP, in the mood that it was told; a context manager.

    Attributes:
        mood: what it does from the next picture on; `change` waits for that.
        last_s: when the newest picture went out, monotonic.

    """

    def __init__(self, port: int, mood: Mood = "good") -> None:
        self._port = port
        self.mood: Mood = mood
        self.last_s = 0.0
        self._good = [_jpeg(_noise(seed, HEIGHT_PX, WIDTH_PX)) for seed in range(PICTURES)]
        self._bad = {
            "black": [
                _jpeg(np.full((HEIGHT_PX, WIDTH_PX, 3), level, np.uint8)) for level in (0, 2)
            ],
            "frozen": [_jpeg(_noise(99, HEIGHT_PX, WIDTH_PX))],
            "wrong-shape": [_jpeg(_noise(0, HEIGHT_PX, WIDTH_PX // 2))],
        }
        self._server: MjpegServer | None = None
        self._beats = 0
        self._beat = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self.revive()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        self._thread.join(5)
        self.die()

    def change(self, mood: Mood) -> float:
        """Take on another mood. Returns when the last picture of the old one went out."""
        with self._beat:
            self.mood, last_s = mood, self.last_s
            beats = self._beats
            self._beat.wait_for(lambda: self._beats > beats, 5)
        return last_s

    def die(self) -> float:
        """Cut every connection and take no more. Returns when the last picture went out."""
        with self._beat:
            server, self._server = self._server, None
            last_s = self.last_s
        if server is not None:
            server.__exit__(None, None, None)
        return last_s

    def revive(self) -> None:
        """Be there again, at the same port."""
        server = MjpegServer(self._port).__enter__()
        with self._beat:
            self._server = server

    def reopen(self, mood: Mood) -> float:
        """Cut every connection and be there again in another mood. Returns as `die`."""
        last_s = self.die()
        self.change(mood)
        self.revive()
        return last_s

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._closing:
            with self._beat:
                self._beats += 1
                if self._server is not None and self.mood != "silent":
                    jpegs = self._bad.get(self.mood, self._good)
                    self._server.publish(jpegs[self._beats % len(jpegs)])
                    self.last_s = time.monotonic()
                self._beat.notify_all()
            due_s = max(due_s + FRAME_S, time.monotonic() - FRAME_S)
            time.sleep(max(0.0, due_s - time.monotonic()))
