"""A recording's camera: frames in which a policy sees again what it saw, at the times it did.

A recording has the policy's pictures, not the camera's. So each is drawn back into a frame of the
camera, from which the daemon cuts the same view out; what lies beside that view is not known and
takes its nearest edge. Nobody's driving changes what is seen.
"""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FULL_VIEW, OBSERVATION_SIDE_PX, FieldOfView
from mbot_workstation.pictures.picture_file import observation

LONGEST_PAUSE_S = 1.0
"""Between two beats, such as of two lives of a daemon; a still picture for longer is a fault."""

_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 97, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111]
"""Without subsampled colours: the picture has been through a camera's coder already."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture of the recording.

    Attributes:
        since_s: when it is shown, from the beginning of a round.
        jpeg: as the camera delivers it.

    """

    since_s: float
    jpeg: bytes


class BackProjection:
    """Draws what a policy saw, of one view, into frames of one camera."""

    def __init__(self, camera: CameraModel, view: FieldOfView) -> None:
        side = OBSERVATION_SIDE_PX
        ideal = CameraModel.from_field_of_view(side, side, view.horizontal_deg, view.vertical_deg)
        columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
        found = cv2.undistortPoints(
            pixels, camera.matrix, np.array(camera.distortion), P=ideal.matrix
        )
        shape = (camera.height_px, camera.width_px)
        self._map_x = found[:, 0, 0].reshape(shape).astype(np.float32)
        self._map_y = found[:, 0, 1].reshape(shape).astype(np.float32)

    def frame(self, observation: Picture) -> Picture:
        """A frame, shape (height, width, 3), of an observation, shape (64, 64, 3); both RGB."""
        # Nearest: the daemon averages over areas, which gives each pixel back as it was.
        nearest, edge = cv2.INTER_NEAREST, cv2.BORDER_REPLICATE
        drawn = cv2.remap(observation, self._map_x, self._map_y, nearest, borderMode=edge)
        return cast(Picture, drawn)


def frames(drive: RecordedDrive, camera: CameraModel) -> tuple[Frame, ...]:
    """The frames of a drive, from 0 s on; pauses are shortened.

    Raises:
        ConfigurationError: there are no pictures in it.

    """
    ways: dict[FieldOfView, BackProjection] = {}
    found: list[Frame] = []
    at_s, before_s = 0.0, 0.0
    for beat in drive.beats:
        seen = observation(beat)
        if seen is None:
            continue
        since_s = drive.since_s(beat)
        if found:
            at_s += min(LONGEST_PAUSE_S, max(0.0, since_s - before_s))
        before_s = since_s
        view = beat.view or FULL_VIEW
        if view not in ways:
            ways[view] = BackProjection(camera, view)
        found.append(Frame(at_s, _jpeg(ways[view].frame(seen))))
    if not found:
        raise ConfigurationError(f"{drive.name} has no pictures: nothing can be played")
    return tuple(found)


class ReplayedCamera:
    """Plays frames round and round, each again and again until the next, as a camera does.

    Attributes:
        rounds: ended so far.
        delivered: pictures so far, repetitions included.

    """

    def __init__(
        self, shown: Sequence[Frame], frame_rate_hz: float, publish: Callable[[bytes], None]
    ) -> None:
        self._shown = shown
        self._period_s = 1 / frame_rate_hz
        self._publish = publish
        self.rounds = 0
        self.delivered = 0

    def run(self, stop: threading.Event) -> None:
        """Play until stopped."""
        began_s = time.monotonic()
        for due_s, jpeg in self._schedule():
            if stop.wait(max(0.0, began_s + due_s - time.monotonic())):
                return
            self._publish(jpeg)
            self.delivered += 1

    def _schedule(self) -> Iterator[tuple[float, bytes]]:
        """When which picture is due, without end."""
        last_s = self._shown[-1].since_s
        between_s = last_s / (len(self._shown) - 1) if len(self._shown) > 1 else 0.0
        round_s = last_s + max(self._period_s, between_s)
        while True:
            for frame, following in zip(self._shown, [*self._shown[1:], None], strict=True):
                until_s = following.since_s if following is not None else round_s
                times = max(1, round((until_s - frame.since_s) / self._period_s))
                for repetition in range(times):
                    shift_s = (until_s - frame.since_s) * repetition / times
                    yield self.rounds * round_s + frame.since_s + shift_s, frame.jpeg
            self.rounds += 1


def _jpeg(picture: Picture) -> bytes:
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(".jpg", bgr, _JPEG)
    return np.asarray(encoded).tobytes()
