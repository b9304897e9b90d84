"""The capture thread: keeps the newest good frame and says when there is none."""

import logging
import threading
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from mbot_agent.configuration import Camera
from mbot_agent.faults import Fault
from mbot_agent.frame_sources import CameraError, FrameSource, frame_source, is_real_camera
from mbot_protocol.picture import Picture

log = logging.getLogger(__name__)

BLACK_BELOW = 6.0
"""Mean of 255 under which a frame shows nothing: a covered lens with the gain up stays below it,
a room at night does not (judged)."""

FROZEN_AFTER_NS = 300_000_000
"""Ten identical frames at 30 frames/s; sensor noise makes even two improbable."""

STILL_WHILE_DRIVING_NS = 1_000_000_000
"""For streams that may repeat exactly while the robot stands: so long may it drive before the
picture must change. Two decisions and the motors' and the camera's delay."""

INTERVAL_WEIGHT = 1 / 32
"""Of the newest interval in the running mean: about a second at 30 frames/s."""

BACK_OFF_S = (0.2, 0.5, 1.0, 2.0)
"""Waits between attempts to open the camera; the last one repeats."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame that passed the checks; `picture` is RGB, shape (height, width, 3)."""

    picture: Picture
    captured_ns: int


def differs(one: Picture, other: Picture) -> bool:
    """Whether two pictures of one shape differ anywhere; a few rows usually tell."""
    return one[::16].tobytes() != other[::16].tobytes() or one.tobytes() != other.tobytes()


class FrameCheck:
    """Judges each frame of a stream by its shape, its light and its difference from the last."""

    def __init__(self, camera: Camera) -> None:
        self._shape = (
            None
            if camera.width_px is None or camera.height_px is None
            else (camera.height_px, camera.width_px, 3)
        )
        self._camera = camera
        self._refuse_identical = camera.identical_frames == "refuse" or (
            camera.identical_frames == "auto" and is_real_camera(camera)
        )
        self._last: Picture | None = None
        self._changed_ns = 0
        self._driving_since_ns: int | None = None
        self._frozen = False

    def drives(self, driving: bool) -> None:
        """Say whether the wheels are being turned now."""
        if not driving:
            self._driving_since_ns = None
        elif self._driving_since_ns is None:
            self._driving_since_ns = time.monotonic_ns()

    def forgive(self) -> None:
        """A person wants to drive again: believe a picture that stood still once more."""
        self._frozen = False

    def judge(self, picture: Picture, captured_ns: int) -> Fault | None:
        """The fault of this frame; None if it may be driven on."""
        if self._shape is None and picture.ndim == 3 and picture.shape[2] == 3:
            self._shape = picture.shape
        if picture.shape != self._shape or picture.dtype != np.uint8:
            return Fault(
                "camera-wrong-shape",
                f"frame is {picture.dtype} {picture.shape}, expected uint8 {self._shape}: set "
                "camera.width_px and camera.height_px to what the camera delivers",
            )
        height_px, width_px, _ = picture.shape
        if not self._camera.is_calibrated_for(width_px, height_px):
            return Fault(
                "camera-wrong-shape",
                f"frames are {width_px} x {height_px}, another shape than the calibrated camera's: "
                "set camera.width_px and camera.height_px to its shape, or calibrate at this one",
            )
        changed = self._last is None or differs(picture, self._last)
        self._last = picture
        if changed:
            self._changed_ns, self._frozen = captured_ns, False
        elif self._stands_still_too_long(captured_ns):
            self._frozen = True
        if self._frozen:
            return Fault(
                "camera-frozen",
                "the camera repeats the same picture: restart it; for a simulated camera without "
                'noise set camera.identical_frames = "refuse-while-driving"',
            )
        if float(picture[::8, ::8].mean()) < BLACK_BELOW:
            return Fault("camera-black", "the picture is black: lens cap, light or cable?")
        return None

    def _stands_still_too_long(self, now_ns: int) -> bool:
        if self._refuse_identical:
            return now_ns - self._changed_ns >= FROZEN_AFTER_NS
        if self._driving_since_ns is None:
            return False
        since_ns = max(self._changed_ns, self._driving_since_ns)
        return now_ns - since_ns >= STILL_WHILE_DRIVING_NS


class CaptureThread:
    """Reads the camera as fast as it delivers, reopening it when it fails. A context manager."""

    def __init__(self, camera: Camera) -> None:
        self.check = FrameCheck(camera)
        self._camera = camera
        self._stale_after_ns = int(camera.stale_after_ms * 1e6)
        self._newest: Frame | None = None
        self._fault: Fault | None = Fault("camera-starting", "no frame has come yet")
        self._interval_ns = 0.0
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closing.set()
        self._thread.join(timeout=2.0)

    def latest(self) -> Frame | None:
        """The newest good frame, however old."""
        return self._newest

    @property
    def interval_ns(self) -> int:
        """Time between two frames, as a running mean; 0 before there are two."""
        return round(self._interval_ns)

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
        failures = 0
        while not self._closing.is_set():
            try:
                with frame_source(self._camera) as source:
                    log.info("camera %r is open", self._camera.source)
                    # A server hands its newest picture to whoever connects, however long ago the
                    # camera stalled; only what comes after it is known to be of now.
                    source.read()
                    while not self._closing.is_set():
                        self._take(source)
                        failures = 0
            except CameraError as error:
                self._note(Fault("camera-lost", str(error)))
            except Exception as error:
                log.exception("the camera thread stumbled; opening the camera anew")
                self._note(Fault("camera-lost", f"internal error: {error}"))
            self._closing.wait(BACK_OFF_S[min(failures, len(BACK_OFF_S) - 1)])
            failures += 1

    def _take(self, source: FrameSource) -> None:
        picture, captured_ns = source.read()
        fault = self.check.judge(picture, captured_ns)
        self._note(fault)
        if fault is None and self._newest is not None:
            interval_ns = captured_ns - self._newest.captured_ns
            weight = INTERVAL_WEIGHT if self._interval_ns else 1.0
            self._interval_ns += weight * (interval_ns - self._interval_ns)
        # A refused frame must not leave the last good one looking fresh.
        self._newest = Frame(picture, captured_ns) if fault is None else None

    def _note(self, fault: Fault | None) -> None:
        previous = self._fault
        if fault is not None and (previous is None or previous.kind != fault.kind):
            log.warning("%s", fault.detail)
        self._fault = fault
