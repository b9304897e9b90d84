"""The robot's camera in real time: pictures at the frame rate, each delivered a latency later."""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from mbot_protocol.picture import Picture
from mbot_workstation.simulation.camera_renderer import CameraRenderer
from mbot_workstation.simulation.scene_renderer import SHOW, Quality
from mbot_workstation.simulation.simulation import Simulation
from mbot_workstation.virtual.scene_history import SceneHistory

JPEG_QUALITY = 90
"""About 10 kB at 320 x 240; what the paper's M-JPEG camera and most web cameras use."""


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """How the camera takes pictures.

    Attributes:
        width_px, height_px: their size.
        frame_rate_hz: how many a second.
        latency_s: from the end of the exposure until the picture is delivered; 0.04-0.08 on the
            robot (assumed).
        exposure_s: of the shutter; 0 freezes the motion.
        exposure_moments: pictures averaged over the exposure; each costs as much as one picture.
        quality: of the drawing.
        noise_seed: of the sensor's noise; None has none.
        gains: of red, green and blue: exposure and white balance.

    """

    width_px: int = 320
    height_px: int = 240
    frame_rate_hz: float = 30.0
    latency_s: float = 0.060
    exposure_s: float = 0.0
    exposure_moments: int = 3
    quality: Quality = SHOW
    noise_seed: int | None = 0
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)


class CameraStream:
    """Draws, encodes and delivers; everything in the thread that calls `run`.

    Attributes:
        frames: pictures taken so far.

    """

    def __init__(
        self,
        simulation: Simulation,
        history: SceneHistory,
        settings: CameraSettings,
        publish: Callable[[bytes], None],
    ) -> None:
        self._simulation = simulation
        self._history = history
        self._settings = settings
        self._publish = publish
        self._pending: deque[tuple[float, bytes]] = deque()
        self.frames = 0
        self.newest: Picture | None = None
        """The picture taken last, not yet delivered."""

    def run(self, stop: threading.Event) -> None:
        """Take pictures until stopped."""
        settings = self._settings
        period_s = 1 / settings.frame_rate_hz
        with CameraRenderer(
            self._simulation,
            settings.width_px,
            settings.height_px,
            settings.quality,
            noise_seed=settings.noise_seed,
            gains=settings.gains,
        ) as renderer:
            frame_s = time.monotonic()
            while True:
                wake_s = min(frame_s, self._pending[0][0]) if self._pending else frame_s
                if stop.wait(max(0.0, wake_s - time.monotonic())):
                    return
                self._deliver()
                late_s = time.monotonic() - frame_s
                if late_s >= 0:
                    self._take(renderer)
                    frame_s += period_s * (1 + math.floor(late_s / period_s))

    def _take(self, renderer: CameraRenderer) -> None:
        settings = self._settings
        taken_s = time.monotonic()
        moments = (
            self._history.exposure(settings.exposure_s, settings.exposure_moments)
            if settings.exposure_s > 0
            else self._history.newest()
        )
        self.newest = renderer.picture(moments)
        self._pending.append((taken_s + settings.latency_s, encode(self.newest)))
        self.frames += 1

    def _deliver(self) -> None:
        while self._pending and self._pending[0][0] <= time.monotonic():
            self._publish(self._pending.popleft()[1])


def encode(picture: Picture) -> bytes:
    """A picture as JPEG."""
    bgr = cast(Picture, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return np.asarray(encoded).tobytes()
