"""Frames that a recording's telemetry holds: what the robot saw in the session's first run.

Only that run certainly began where everything else counts from: on the cross where the panorama
was taken, facing its middle.
"""

from pathlib import Path
from typing import cast

import cv2
import numpy as np

from mbot_protocol.picture import Picture
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.gap_report.compared_run import ComparedRun
from mbot_workstation.gap_report.frame_pair import RealFrame
from mbot_workstation.gap_report.simulated_view import Place
from mbot_workstation.recordings.drive_mcap import read_recording
from mbot_workstation.recordings.recording_folder import TELEMETRY_FILE
from mbot_workstation.simulation.pose import ORIGIN, Pose

MOMENTS = (-1e-9, 0.35, 0.7)
"""Of the drive, as shares; the first is the last picture before it."""

NEAR_S = 0.5
"""Pictures are 0.4 s apart, a decision's period."""

STANDING_S = 1.5
"""Before the first command; any picture of it will do."""

OBSERVATION_SHAPE = (64, 64, 3)


def telemetry_frames(folder: Path, first: ComparedRun, start_s: float) -> tuple[RealFrame, ...]:
    """Up to three pictures of the first run.

    Args:
        folder: the recording's.
        first: the session's first run.
        start_s: of its first command, on the robot's clock.

    Returns:
        None at all if there is no telemetry, or it holds no pictures of that time.

    Raises:
        ConfigurationError: the file is no MCAP file.

    """
    path = folder / TELEMETRY_FILE
    if not path.exists():
        return ()
    seen = _pictures_between(path, start_s - STANDING_S, start_s + first.driven_s)
    frames: list[RealFrame] = []
    for share in MOMENTS:
        wanted_s = start_s + share * first.driven_s
        before = [moment_s for moment_s in seen if moment_s <= wanted_s]
        if not before or wanted_s - before[-1] > (STANDING_S if share < 0 else NEAR_S):
            continue
        since_s = before[-1] - start_s
        title = "before it starts" if since_s <= 0 else f"{since_s:.1f} s into {first.maneuver}"
        place = Place(_pose(first, since_s))
        frames.append(RealFrame(title, seen[before[-1]], place, is_observation=True))
    return tuple(frames)


def _pictures_between(path: Path, first_s: float, last_s: float) -> dict[float, Picture]:
    """Pictures by when they were taken, on the robot's clock, in order."""
    captured_s: dict[int, float] = {}
    coded: dict[int, bytes] = {}
    for _topic, message in read_recording(path):
        if isinstance(message, Decision):
            if message.captured_monotonic_ns:
                captured_s[message.unix_time_ns] = message.captured_monotonic_ns / 1e9
        else:
            coded[message.timestamp.ToNanoseconds()] = message.data
    found: dict[float, Picture] = {}
    for stamp_ns, moment_s in sorted(captured_s.items(), key=lambda item: item[1]):
        # A decision and its picture carry the same time; either may have got lost.
        if stamp_ns in coded and first_s <= moment_s <= last_s:
            pixels = np.frombuffer(coded[stamp_ns], np.uint8)
            picture = cv2.imdecode(pixels, cv2.IMREAD_COLOR)
            if picture is not None and picture.shape == OBSERVATION_SHAPE:
                found[moment_s] = cast(Picture, cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    return found


def _pose(run: ComparedRun, since_s: float) -> Pose:
    if since_s <= 0:
        return ORIGIN
    x_m, y_m, yaw_rad = (np.interp(since_s, run.time_s, column) for column in run.measured.T)
    return Pose(float(x_m), float(y_m), float(yaw_rad))
