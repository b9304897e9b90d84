import threading
import time
from typing import Any

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot_agent import configuration
from mbot_agent.arming import Mode, Orders
from mbot_agent.faults import Notice
from mbot_agent.network.telemetry_publisher import BACKLOG, Telemetry
from mbot_agent.network.wire_messages import beat_of
from mbot_agent.tick import Tick
from mbot_protocol.beat.beat import Beat
from mbot_protocol.drive.actions import AS_BUILT
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_protocol.wire.keys import CAMERA, DECISION, OBSERVATION, Topic


class Wire:
    """Keeps what is published; can be made as slow as a bad link."""

    def __init__(self) -> None:
        self.sent: list[tuple[Topic, bytes]] = []
        self.open = threading.Event()
        self.open.set()
        self.watched = True
        self.looked_at: Topic = OBSERVATION

    def is_watched(self, topic: Topic) -> bool:
        return self.watched and topic is self.looked_at

    def publish(self, topic: Topic, payload: bytes) -> None:
        self.open.wait(10)
        self.sent.append((topic, payload))


FRAME = np.full((480, 640, 3), 90, np.uint8)
NOTICE = Notice("model-rolled-back", "new was rolled back to old: nonsense")


def tick(sequence: int, observation: np.ndarray | None = None) -> Tick:
    now_ns = time.monotonic_ns()
    return Tick(sequence, now_ns, now_ns, 0, Orders(Mode.IDLE, 0), observation=observation)


def to_beat(tick: Tick) -> Beat:
    return beat_of(tick, "mbot-1", 42, (NOTICE,), AS_BUILT)


def telemetry_to(wire: Wire, **settings: Any) -> Telemetry:
    return Telemetry(wire, to_beat, configuration.Telemetry(**settings), lambda: FRAME)


@pytest.mark.parametrize("watched", [True, False])
@pytest.mark.parametrize("pictures", [True, False, "while-watched"])
def test_pictures_are_made_for_whom_they_are_for(
    pictures: Any, watched: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire = Wire()
    wire.watched = watched
    encoded: list[str] = []
    encode = cv2.imencode
    monkeypatch.setattr(cv2, "imencode", lambda *a: encoded.append("one") or encode(*a))
    with telemetry_to(wire, pictures=pictures) as telemetry:
        telemetry.offer(tick(1, np.full((64, 64, 3), 90, np.uint8)))
    wanted = pictures is True or (pictures == "while-watched" and watched)
    assert len(encoded) == wanted
    assert [topic for topic, _ in wire.sent] == ([DECISION, OBSERVATION] if wanted else [DECISION])


@pytest.mark.parametrize("pictures", [True, False, "while-watched"])
def test_the_camera_is_shown_to_who_looks_smaller_and_unless_nobody_may(pictures: Any) -> None:
    wire = Wire()
    wire.looked_at = CAMERA
    with telemetry_to(wire, pictures=pictures) as telemetry:
        telemetry.offer(tick(1))
    seen = [data for topic, data in wire.sent if topic is CAMERA]
    assert len(seen) == (pictures is not False)
    for data in seen:
        jpeg = np.frombuffer(CompressedImage.FromString(data).data, np.uint8)
        picture = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape == (240, 320, 3)


def test_a_record_and_its_picture_are_published() -> None:
    wire = Wire()
    red = np.zeros((64, 64, 3), np.uint8)
    red[..., 0] = 250
    with telemetry_to(wire) as telemetry:
        telemetry.offer(tick(7, red))
    (first, decision_bytes), (second, picture_bytes) = wire.sent
    assert (first, second) == (DECISION, OBSERVATION)
    decision = Decision.FromString(decision_bytes)
    assert decision.sequence == 7
    assert (decision.robot_id, decision.session_id) == ("mbot-1", 42)
    (notice,) = decision.notices
    assert (notice.kind, notice.detail) == (NOTICE.kind, NOTICE.detail)
    assert abs(decision.unix_time_ns - time.time_ns()) < 5e9
    assert decision.resident_memory_bytes > 1e6
    picture = CompressedImage.FromString(picture_bytes)
    assert picture.timestamp.ToNanoseconds() == decision.unix_time_ns
    bgr = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    assert bgr[32, 32].tolist()[2] > 200
    assert bgr[32, 32].tolist()[0] < 50


def test_a_slow_link_never_holds_up_the_loop_and_losses_are_counted() -> None:
    wire = Wire()
    wire.open.clear()
    with telemetry_to(wire) as telemetry:
        for sequence in range(50):
            telemetry.offer(tick(sequence))  # returns although nothing can be sent
        wire.open.set()
    decisions = [Decision.FromString(data) for _, data in wire.sent]
    assert decisions[-1].sequence == 49
    assert len(decisions) <= BACKLOG + 1
    assert decisions[-1].dropped_records >= 50 - BACKLOG - 2


def test_one_bad_record_does_not_end_telemetry() -> None:
    wire = Wire()
    with telemetry_to(wire) as telemetry:
        telemetry.offer(tick(1, np.zeros((0, 0, 3), np.uint8)))
        telemetry.offer(tick(2))
    assert Decision.FromString(wire.sent[-1][1]).sequence == 2
