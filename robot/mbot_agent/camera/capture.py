"""The capture thread: keeps the newest good frame and says when there is none."""

import logging
import threading
import time
from typing import Self

from mbot_agent.camera.automatics import Automatics, Light
from mbot_agent.camera.frame_sources import frame_source
from mbot_agent.camera.picture_check import PictureCheck, is_black
from mbot_agent.camera.source_contract import CameraError, FrameSource, JpegError, Shot
from mbot_agent.configuration import CameraSettings, shown_source
from mbot_agent.faults import Fault
from mbot_agent.hardware import Frame
from mbot_protocol.back_off import BackOff
from mbot_protocol.drive.picture import Picture

log = logging.getLogger(__name__)

LOOK_EVERY_NS = 100_000_000
"""So often at least is a picture looked at where that takes decoding: all of 30 JPEGs a second are
half of what the daemon costs (measured). Of the others the shape is checked; those that are decided
on are looked at in any case."""

INTERVAL_WEIGHT = 1 / 32
"""Of the newest interval in the running mean: about a second at 30 frames/s."""


class CaptureThread:
    """Reads the camera as fast as it delivers, reopening it when it fails. A context manager."""

    def __init__(self, camera: CameraSettings) -> None:
        self._check = PictureCheck(camera)
        self._camera = camera
        self._stale_after_ns = int(camera.stale_after_ms * 1e6)
        self._newest: Shot | None = None
        self._looked_ns: int | None = None  # None: the next one is looked at
        self._fault: Fault | None = Fault("camera-starting", "no frame has come yet")
        self._interval_ns = 0.0
        self._automatics = Automatics(camera.automatic)
        self._light: Light = "unknown"
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._closing.set()
        self._thread.join(timeout=2.0)

    def latest(self) -> Frame | None:
        """The newest good frame, however old. For one thread: it may have to be decoded."""
        newest = self._newest
        if newest is None:
            return None
        try:
            picture = newest.picture()
        except JpegError:
            self._looked_ns = None  # the capture thread shall look at the next one and say so
            return None
        if is_black(picture):
            self._looked_ns = None
            return None
        return Frame(picture, newest.captured_ns)

    def glance(self) -> Picture | None:
        """The newest good frame for people to look at; any thread may ask."""
        newest = self._newest
        try:
            return None if newest is None else newest.picture()
        except JpegError:
            return None

    @property
    def interval_ns(self) -> int:
        """Time between two frames, as a running mean; 0 before there are two."""
        return round(self._interval_ns)

    @property
    def light(self) -> Light:
        """What the camera's automatic exposure and white balance do."""
        return self._light

    def drives(self, driving: bool) -> None:
        """Learn whether the wheels are being turned now: then the picture has to change."""
        self._check.drives(driving)
        self._automatics.drives(driving, time.monotonic_ns())

    def forgive(self) -> None:
        """Believe a picture that stood still once more: a person wants to drive again."""
        self._check.forgive()

    def is_fresh(self) -> bool:
        """Whether the newest good frame is recent enough to drive on."""
        newest = self._newest
        return (
            newest is not None and time.monotonic_ns() - newest.captured_ns <= self._stale_after_ns
        )

    @property
    def fault(self) -> Fault | None:
        """Why the newest picture must not be driven on, if so."""
        if self.is_fresh():
            return None
        if (fault := self._fault) is not None:
            return fault
        return Fault(
            "camera-stalled",
            f"no frame for {self._camera.stale_after_ms:.0f} ms: camera hung, or link too slow",
        )

    def _run(self) -> None:
        back_off = BackOff()
        while not self._closing.is_set():
            try:
                with frame_source(self._camera) as source:
                    log.info("camera %r is open", shown_source(self._camera.source))
                    self._begin(source)
                    while not self._closing.is_set():
                        self._take(source)
                        back_off.succeeded()
            except CameraError as error:
                self._note(Fault("camera-lost", str(error)))
            except Exception as error:  # whatever a camera's library raises, the next try may do
                fault = Fault("camera-lost", f"internal error: {type(error).__name__} {error}")
                if fault != self._fault:
                    log.exception("the camera thread stumbled; reopening the camera")
                self._note(fault)
            self._closing.wait(back_off.next_s())

    def _begin(self, source: FrameSource) -> None:
        # A server hands its newest picture to whoever connects, however long ago the camera
        # stalled; only what comes after it is known to be of now.
        source.read()
        self._automatics.opened(time.monotonic_ns())
        self._light = "automatic" if source.hold_light(False) else "unknown"

    def _take(self, source: FrameSource) -> None:
        shot = source.read()
        self._adjust(source)
        fault = self._judge(shot)
        self._note(fault)
        if fault is None and self._newest is not None:
            interval_ns = shot.captured_ns - self._newest.captured_ns
            weight = INTERVAL_WEIGHT if self._interval_ns else 1.0
            self._interval_ns += weight * (interval_ns - self._interval_ns)
        # A refused frame must not leave the last good one looking fresh.
        self._newest = shot if fault is None else None

    def _adjust(self, source: FrameSource) -> None:
        """Hold the light or let go of it, where the source can and it is not so already."""
        held = self._automatics.held(time.monotonic_ns())
        if self._light != "unknown" and held != (self._light == "held"):
            done = source.hold_light(held)
            self._light = ("held" if held else "automatic") if done else "unknown"

    def _judge(self, shot: Shot) -> Fault | None:
        """Look at a frame, or at its shape alone if the last look was good and not long ago."""
        looked_ns = None if self._newest is None else self._looked_ns
        is_due = looked_ns is None or shot.captured_ns - looked_ns >= LOOK_EVERY_NS
        if not (shot.is_decoded or is_due):
            return self._check.judge_shape(shot.shape)
        self._looked_ns = shot.captured_ns
        try:
            return self._check.judge(shot.picture(), shot.captured_ns)
        except JpegError as error:
            return Fault("camera-damaged", f"the camera sends a damaged picture: {error}")

    def _note(self, fault: Fault | None) -> None:
        previous = self._fault
        if fault is not None and (previous is None or previous.kind != fault.kind):
            log.warning("%s", fault.detail)
        self._fault = fault
