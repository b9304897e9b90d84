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

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer, Shutter
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.camera.scene_renderer import SHOW, Quality
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.virtual.scene_history import SceneHistory

JPEG_QUALITY = 90
"""About 10 kB at 320 x 240; what the paper's M-JPEG camera and most web cameras use."""


USUAL_SHUTTER = Shutter(exposure_s=0.020, readout_s=0.023)
"""Indoors, and the IMX477's read-out; assumed."""

NOISY = IspSettings(noise=1.0)


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """How the camera takes pictures.

    Attributes:
        width_px, height_px: their size.
        frame_rate_hz: how many a second.
        latency_s: from the end of the exposure until the picture is delivered; 0.04-0.08 on the
            robot (assumed).
        shutter: what blurs and shears turns; 20 ms and the IMX477's 23 ms.
        isp: the camera's processing, but for the coder.
        jpeg_quality: of the stream.
        quality: of the drawing.
        noise_seed: of the sensor's noise.

    """

    width_px: int = 320
    height_px: int = 240
    frame_rate_hz: float = 30.0
    latency_s: float = 0.060
    shutter: Shutter = USUAL_SHUTTER
    isp: IspSettings = NOISY
    jpeg_quality: int = JPEG_QUALITY
    quality: Quality = SHOW
    noise_seed: int = 0


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
            shutter=settings.shutter,
            isp=settings.isp,
            noise_seed=settings.noise_seed,
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
        shutter = settings.shutter
        state, turn_rate = self._history.glance((shutter.exposure_s + shutter.readout_s) / 2)
        self.newest = renderer.picture(state, turn_rate, taken_s)
        self._pending.append(
            (taken_s + settings.latency_s, encode(self.newest, settings.jpeg_quality))
        )
        self.frames += 1

    def _deliver(self) -> None:
        while self._pending and self._pending[0][0] <= time.monotonic():
            self._publish(self._pending.popleft()[1])


def encode(picture: Picture, quality: int = JPEG_QUALITY) -> bytes:
    """A picture as JPEG."""
    bgr = cast(Picture, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(encoded).tobytes()
