"""Telemetry as it arrives: typed samples, and whether any arrive at all."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum
from typing import Self

import zenoh
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import DecodeError

from mbot_protocol.policy.policy_contract import DECISION_RATE_HZ
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_protocol.wire.keys import CAMERA, DECISION, OBSERVATION
from mbot_protocol.wire.schema import MalformedMessageError, decode
from mbot_workstation.fleet.link.robot_link import RobotLink

SILENT_AFTER_PERIODS = 3
DEPTH = 64
"""Samples kept for a slow reader, 25 s at 2.5 Hz; then the oldest give way to the newest."""

_POLL_S = 0.02  # the ring channels have no timed wait; 50 looks a second cost nothing


@dataclass(frozen=True, slots=True)
class Sample:
    """One message of telemetry and when it came.

    Attributes:
        message: a decision, or the observation's picture that led to one.
        arrived_s: this machine's monotonic clock.
        of_camera: whether a picture is what the camera sees, and not what the policy saw.

    """

    message: Decision | CompressedImage
    arrived_s: float
    of_camera: bool = False


class LinkState(Enum):
    """What is known of the robot from its telemetry."""

    LIVE = "live"
    SILENT = "silent"
    """The daemon is connected but sends nothing: the link or the robot is overloaded."""
    GONE = "gone"
    """The daemon is not connected: stopped, switched off, or the network is cut."""


class TelemetryStream:
    """The telemetry of one robot; a context manager. Survives a restart of the robot.

    Attributes:
        malformed: messages that could not be read, and were left out.

    """

    def __init__(
        self,
        link: RobotLink,
        decision_rate_hz: float = DECISION_RATE_HZ,
        monotonic_s: Callable[[], float] = time.monotonic,
        *,
        camera: bool = False,
    ) -> None:
        """Prepare a stream over an open link.

        Args:
            link: to the robot.
            decision_rate_hz: as the robot's Status has it; 0 where it says nothing.
            monotonic_s: this machine's monotonic clock.
            camera: also ask for the camera's pictures; a robot sends them to who asks only.

        """
        self._with_camera = camera
        self._camera: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]] | None = None
        self.malformed = 0
        self._link = link
        self._silent_after_s = SILENT_AFTER_PERIODS / (decision_rate_hz or DECISION_RATE_HZ)
        self._monotonic_s = monotonic_s
        self._last_s = monotonic_s()
        self._alive = True
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._decisions = stack.enter_context(self._link.subscribe(DECISION, DEPTH))
            self._pictures = stack.enter_context(self._link.subscribe(OBSERVATION, DEPTH))
            if self._with_camera:
                self._camera = stack.enter_context(self._link.subscribe(CAMERA, 1))
            self._presence = stack.enter_context(self._link.watch_alive())
            self._stack = stack.pop_all()
        self._last_s = self._monotonic_s()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def silence_s(self) -> float:
        """Time since the last message, or since the stream was opened."""
        return self._monotonic_s() - self._last_s

    @property
    def state(self) -> LinkState:
        """Whether telemetry arrives; silent after three periods without any."""
        if self.silence_s <= self._silent_after_s:
            return LinkState.LIVE
        return LinkState.SILENT if self._alive else LinkState.GONE

    def poll(self, wait_s: float = 0.0) -> list[Sample]:
        """All that has arrived; waits up to `wait_s` for a first one.

        Raises:
            NewerSchemaError: the robot speaks a newer schema; its records would be misread.

        """
        until_s = self._monotonic_s() + wait_s
        while not (samples := list(self._drain())) and self._monotonic_s() < until_s:
            time.sleep(_POLL_S)
        return samples

    def _drain(self) -> Iterator[Sample]:
        while (presence := self._presence.try_recv()) is not None:
            self._alive = presence.kind == zenoh.SampleKind.PUT
        # A picture before its decision: whoever shows a decision then has its picture.
        while (picture := self._pictures.try_recv()) is not None:
            yield from self._sample(picture, _to_picture)
        while self._camera is not None and (seen := self._camera.try_recv()) is not None:
            yield from self._sample(seen, _to_picture, of_camera=True)
        while (decision := self._decisions.try_recv()) is not None:
            yield from self._sample(decision, self._to_decision)

    def _sample(
        self,
        raw: zenoh.Sample,
        read: Callable[[bytes], Decision | CompressedImage],
        *,
        of_camera: bool = False,
    ) -> Iterator[Sample]:
        try:
            message = read(raw.payload.to_bytes())
        except (MalformedMessageError, DecodeError):
            self.malformed += 1
            return
        self._last_s = self._monotonic_s()
        yield Sample(message, self._last_s, of_camera)

    def _to_decision(self, data: bytes) -> Decision:
        return decode(Decision, data, f"robot {self._link.robot_id}")


def _to_picture(data: bytes) -> CompressedImage:
    picture = CompressedImage()
    picture.ParseFromString(data)
    return picture
