"""A robot's telemetry for Foxglove and Lichtblick: plain topics on their websocket, on loopback.

foxglove-sdk is the extra `[foxglove]`; nothing else here imports it. Topics are those of our
MCAP files.
"""

import importlib
import math
from contextlib import ExitStack
from typing import Any, Self

import msgspec
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot_protocol.beat.changes import changes
from mbot_protocol.beat.channels import (
    CAMERA_TOPIC,
    DRIVE_TOPIC,
    LOG_TOPIC,
    OBSERVATION_TOPIC,
    POSE_TOPIC,
    topic,
)
from mbot_protocol.beat.fields import drive_numbers, drive_schema
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.telemetry.stream import Sample
from mbot_workstation.look.drives.driven_path import Place
from mbot_workstation.wording import one_line

LOOPBACK = "127.0.0.1"
DEFAULT_PORT = 8765
FLOOR_FRAME = "floor"
"""Metres, x to the right and y up, from the arena's middle."""

_LEVELS = {"INFO": "Info", "WARN": "Warning", "ERROR": "Error"}


class FoxgloveBridge:
    """The server, and one robot's channels. A context manager."""

    def __init__(self, robot_id: str, port: int = DEFAULT_PORT) -> None:
        """Prepare.

        Args:
            robot_id: the topics' middle part: `/mbot/ID/...`.
            port: on loopback; 0: any free one.

        Raises:
            ConfigurationError: foxglove-sdk is not installed.

        """
        try:
            self._foxglove: Any = importlib.import_module("foxglove")
            channels: Any = importlib.import_module("foxglove.channels")
            self._messages: Any = importlib.import_module("foxglove.messages")
        except ModuleNotFoundError as error:
            raise ConfigurationError(
                f"--foxglove needs {error.name}: pip install -c constraints.txt -e '.[foxglove]' "
                "in the checkout"
            ) from None
        context = self._foxglove.Context()
        picture_channel = channels.CompressedImageChannel
        self._robot_id = robot_id
        self._port = port
        self._context = context
        self._observation = picture_channel(topic(robot_id, OBSERVATION_TOPIC), context=context)
        self._camera = picture_channel(topic(robot_id, CAMERA_TOPIC), context=context)
        self._pose = channels.PoseInFrameChannel(topic(robot_id, POSE_TOPIC), context=context)
        self._log = channels.LogChannel(topic(robot_id, LOG_TOPIC), context=context)
        self._beat = self._foxglove.Channel(
            topic(robot_id, DRIVE_TOPIC),
            schema=msgspec.json.decode(drive_schema()),
            context=context,
        )
        self._before: Decision | None = None
        self._end = ExitStack()

    def __enter__(self) -> Self:
        """Listen.

        Raises:
            ConfigurationError: the port is taken.

        """
        try:
            server = self._foxglove.start_server(
                name=f"mbot-agent: {self._robot_id}",
                host=LOOPBACK,
                port=self._port,
                context=self._context,
            )
        except Exception as error:  # the library has no class of its own for a taken port
            raise ConfigurationError(
                f"can't listen on {LOOPBACK}:{self._port}: {error} (--foxglove-port)"
            ) from None
        self._port = server.port
        self._end.callback(server.stop)
        return self

    def __exit__(self, *_: object) -> None:
        self._end.close()

    @property
    def address(self) -> str:
        """What to give to the viewer."""
        return f"ws://{LOOPBACK}:{self._port}"

    def take(self, sample: Sample) -> None:
        """Publish one sample of telemetry."""
        message = sample.message
        if isinstance(message, CompressedImage):
            channel = self._camera if sample.of_camera else self._observation
            stamp_ns = message.timestamp.ToNanoseconds()
            picture = self._messages.CompressedImage(
                timestamp=self._time(stamp_ns),
                frame_id=message.frame_id,
                data=message.data,
                format=message.format,
            )
            channel.log(picture, log_time=stamp_ns)
            return
        time_ns = message.unix_time_ns
        self._beat.log(drive_numbers(message), log_time=time_ns)
        for level, words in changes(self._before, message):
            log = self._messages.Log(
                timestamp=self._time(time_ns),
                level=getattr(self._messages.LogLevel, _LEVELS[level]),
                message=one_line(words),
                name=self._robot_id,
            )
            self._log.log(log, log_time=time_ns)
        self._before = message

    def take_place(self, place: Place) -> None:
        """Publish where it is, which is known of a virtual robot."""
        messages, (x_m, y_m) = self._messages, place.robot
        turned = messages.Quaternion(
            z=math.sin(place.yaw_rad / 2), w=math.cos(place.yaw_rad / 2), x=0.0, y=0.0
        )
        pose = messages.Pose(position=messages.Vector3(x=x_m, y=y_m, z=0.0), orientation=turned)
        stamp = self._time(place.unix_time_ns)
        self._pose.log(
            messages.PoseInFrame(timestamp=stamp, frame_id=FLOOR_FRAME, pose=pose),
            log_time=place.unix_time_ns,
        )

    def _time(self, unix_time_ns: int) -> Any:
        whole_s, nanoseconds = divmod(unix_time_ns, 10**9)
        return self._messages.Timestamp(sec=whole_s, nsec=nanoseconds)
