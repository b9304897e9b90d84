"""Poses from an MCAP file: Foxglove's schemas in protobuf, ROS 2's stamped poses in CDR."""

import logging
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import DecodeError

from mbot_protocol.beat.whole_chunks import WholeChunks
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.raw_track import RawTrack

_log = logging.getLogger(__name__)

MOST_RECORDS = 3600 * 240 * 2
"""An hour of a motion capture's 240 poses a second, and as much of other topics; a session of the
paper's 80 runs takes half of that time, and trackers that one buys give 90 a second."""

_Pose = tuple[float, ...]
"""Time in s, x, y, z, then the quaternion, w first."""


def _pose_in_frame(data: bytes) -> _Pose:
    message = PoseInFrame.FromString(data)
    place, turn = message.pose.position, message.pose.orientation
    time_s = message.timestamp.ToNanoseconds() / 1e9
    return (time_s, place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z)


def _frame_transform(data: bytes) -> _Pose:
    message = FrameTransform.FromString(data)
    place, turn = message.translation, message.rotation
    time_s = message.timestamp.ToNanoseconds() / 1e9
    return (time_s, place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z)


def _ros_pose_stamped(data: bytes) -> _Pose:
    # CDR: 4 bytes say the byte order, then everything is aligned to its size from there on.
    order = "<" if data[1] & 1 else ">"
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, 4)
    numbers_at = 4 + (12 + length + 7) // 8 * 8
    x, y, z, qx, qy, qz, qw = struct.unpack_from(f"{order}7d", data, numbers_at)
    return (seconds + nanoseconds / 1e9, x, y, z, qw, qx, qy, qz)


READERS: dict[tuple[str, str], Callable[[bytes], _Pose]] = {
    ("foxglove.PoseInFrame", "protobuf"): _pose_in_frame,
    ("foxglove.FrameTransform", "protobuf"): _frame_transform,
    ("geometry_msgs/msg/PoseStamped", "cdr"): _ros_pose_stamped,
}


def read_mcap(path: Path, topic: str | None = None) -> RawTrack:
    """The poses of one topic, at the times the messages themselves carry.

    Args:
        path: the file.
        topic: which; None: the only one with poses.

    Raises:
        ConfigurationError: no such file, no poses, or poses on several topics.

    """
    poses: dict[str, list[_Pose]] = {}
    others: set[str] = set()
    chunks, unread = WholeChunks(path), 0
    for message in chunks.messages(MOST_RECORDS):
        read = READERS.get((message.schema, message.encoding))
        if read is None:
            others.add(f"{message.topic} ({message.schema or 'no schema'})")
        elif topic in (None, message.topic):
            try:
                pose = read(message.data)
            except (DecodeError, struct.error, IndexError):
                unread += 1
            else:
                poses.setdefault(message.topic, []).append(pose)
    whole = sum(len(found) for found in poses.values())
    if not chunks.is_whole or unread:
        # What is whole is good; a run that lost its end is found by its length.
        lost = f" and {unread} messages that are none" if unread else ""
        _log.warning(
            "%s was cut off or damaged: %s%s; %d poses are whole",
            path,
            chunks.words,
            lost,
            whole,
        )
    if len(poses) != 1:
        raise ConfigurationError(_choice(path, topic, sorted(poses), sorted(others)))
    ((_topic, found),) = poses.items()
    table = np.array(found, dtype=np.float64)
    places = tuple(f"pose {number}" for number in range(1, len(found) + 1))
    return RawTrack(path, places, table[:, 0], table[:, 1:4], table[:, 4:8])


def _choice(path: Path, topic: str | None, found: list[str], others: list[str]) -> str:
    if found:
        return (
            f"{path} holds poses on {len(found)} topics: {', '.join(found)}; choose one in "
            f'track.toml, such as topic = "{found[0]}"'
        )
    known = ", ".join(name for name, _encoding in READERS)
    what = "no poses" if topic is None else f"no poses on topic {topic!r}"
    there = f"; it holds {', '.join(others)}" if others else ""
    return f"{path} holds {what} (expected one of {known}){there}"
