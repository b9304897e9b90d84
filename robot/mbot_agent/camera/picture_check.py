"""Which frames are too bad to drive on: of another shape, black, or the same again and again."""

import time
from collections import deque

from mbot_agent.camera.frame_sources import is_real_camera
from mbot_agent.configuration import CameraSettings
from mbot_agent.faults import Fault
from mbot_protocol.drive.picture import Picture

BLACK_BELOW = 6.0
"""Mean of 255 under which a frame shows nothing: a covered lens with the gain up stays below it,
a room at night does not (judged)."""

FROZEN_AFTER_NS = 300_000_000
"""Ten identical frames at 30 frames/s; sensor noise makes even two improbable."""

REMEMBERED = 16
"""Pictures. Drivers of cameras have 3 to 8 buffers; V4L2 allows 32 (VIDEO_MAX_FRAME)."""

STILL_WHILE_DRIVING_NS = 1_000_000_000
"""For streams that may repeat exactly while the robot stands: so long may it drive before the
picture must change. Two decisions and the motors' and the camera's delay."""


class RecentPictures:
    """Which pictures have been seen of late: a stuck camera may send four to six old ones in turn,
    its driver's buffers.

    Every sixteenth row is hashed of each picture, the whole only of one whose rows were seen
    before: 0.006 ms at 320 x 240 and 0.02 ms at 640 x 480, not 0.07 and 0.3 (measured, PC).
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[int, int | None]] = deque(maxlen=REMEMBERED)

    def has(self, picture: Picture) -> bool:
        """Whether this one, shape (height, width, 3), was seen before; it is from now on.

        In doubt it was: the whole of the first one with these rows is not known.
        """
        rows = hash(picture[::16].tobytes())
        earlier = [whole for known, whole in self._seen if known == rows]
        whole = hash(picture.tobytes()) if earlier else None
        self._seen.append((rows, whole))
        return bool(earlier) and (whole in earlier or not any(earlier))


def is_black(picture: Picture) -> bool:
    """Whether a picture, shape (height, width, 3), shows nothing; every eighth pixel tells."""
    return float(picture[::8, ::8].mean()) < BLACK_BELOW


class PictureCheck:
    """Judges each frame of a stream by its shape, its light and whether it was seen before."""

    def __init__(self, camera: CameraSettings) -> None:
        size = camera.height_px, camera.width_px
        self._shape = None if None in size else (*size, 3)
        self._camera = camera
        self._refuse_identical = camera.identical_frames == "refuse" or (
            camera.identical_frames == "auto" and is_real_camera(camera)
        )
        self._recent = RecentPictures()
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

    def judge_shape(self, shape: tuple[int, ...], kind: str = "uint8") -> Fault | None:
        """The fault of a frame of this shape and numpy type; None if they are right."""
        if self._shape is None and len(shape) == 3 and shape[2] == 3:
            self._shape = shape
        if shape != self._shape or kind != "uint8":
            return Fault(
                "camera-wrong-shape",
                f"frame is {kind} {shape}, expected uint8 {self._shape}: set "
                "camera.width_px and camera.height_px to what the camera delivers",
            )
        height_px, width_px, _ = shape
        if not self._camera.is_calibrated_for(width_px, height_px):
            return Fault(
                "camera-wrong-shape",
                f"frames are {width_px} x {height_px}, another shape than the calibrated camera's: "
                "set camera.width_px and camera.height_px to its shape, or calibrate at this one",
            )
        return None

    def judge(self, picture: Picture, captured_ns: int) -> Fault | None:
        """The fault of this frame; None if it may be driven on.

        Args:
            picture: shape (height, width, 3), uint8, RGB; anything else is a fault.
            captured_ns: when it was taken, monotonic.

        """
        if (fault := self.judge_shape(picture.shape, str(picture.dtype))) is not None:
            return fault
        if not self._recent.has(picture):
            self._changed_ns, self._frozen = captured_ns, False
        elif self._stands_still_too_long(captured_ns):
            self._frozen = True
        if is_black(picture):  # the better reason: black ones are alike
            return Fault("camera-black", "the picture is black: lens cap, light or cable?")
        if self._frozen:
            mend = (
                "restart it; for a simulated camera without noise set camera.identical_frames = "
                '"refuse-while-driving"'
                if self._refuse_identical
                else "restart it; or free the robot, if it is stuck"
            )
            return Fault("camera-frozen", f"the camera repeats the same picture: {mend}")
        return None

    def _stands_still_too_long(self, now_ns: int) -> bool:
        if self._refuse_identical:
            return now_ns - self._changed_ns >= FROZEN_AFTER_NS
        if self._driving_since_ns is None:
            return False
        since_ns = max(self._changed_ns, self._driving_since_ns)
        return now_ns - since_ns >= STILL_WHILE_DRIVING_NS
