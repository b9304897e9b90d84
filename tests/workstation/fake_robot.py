"""A robot's Zenoh side without a robot: answers the keys with scripted replies."""

import json
import threading
import time
from collections.abc import Callable
from typing import Self

import zenoh
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.message import Message

from mbot_protocol.v1.messages_pb2 import (
    Command,
    CommandReply,
    Decision,
    LastStop,
    Model,
    ModelList,
    Notice,
    PushBegin,
    PushChunk,
    PushNonceReply,
    PushReply,
    State,
    Status,
)
from mbot_protocol.v1.recordings_pb2 import RecordingList
from mbot_protocol.wire.keys import (
    ACTIVATE,
    ALIVE,
    COMMAND,
    DECISION,
    MODELS,
    OBSERVATION,
    PUSH_BEGIN,
    PUSH_CHUNK,
    PUSH_COMMIT,
    PUSH_NONCE,
    RECORDINGS,
    STATUS,
    STOP,
    Topic,
)

from ..free_port import free_port

Reply = Message | bytes | str | None
"""A message, raw bytes, an error's text, or nothing at all."""

ROBOT_ID = "mbot-1"
SESSION_ID = 0xF00D_FEED_0000_0001
NONCE = "5a" * 16
CLOCK_AHEAD_NS = 5_000_000_000_000
"""The robot's monotonic clock is not the workstation's."""

OLD_MODEL = Model(
    sha256="a" * 64,
    name="old",
    size_bytes=1000,
    stored_unix_time_ns=1_700_000_000_000_000_000,
    active=True,
    decision_rate_hz=2.5,
    signed_by="anna",
    proven=True,
)


class FakeRobot:
    """Listens on loopback; `replies` may be changed by a test, `received` tells what came in."""

    def __init__(self, robot_id: str = ROBOT_ID, port: int | None = None, *others: str) -> None:
        self.robot_id = robot_id
        self.port = port or free_port()
        self.address = f"127.0.0.1:{self.port}"
        self.staged = bytearray()
        self.received: list[tuple[str, bytes]] = []
        self.active = OLD_MODEL
        self.trusted_keys: list[str] = []
        self.notices: list[Notice] = []
        self.stops = 1
        self.replies: dict[str, Callable[[bytes], Reply]] = {
            STATUS.name: lambda _data: self.status(),
            COMMAND.name: self._command,
            STOP.name: self._command,
            MODELS.name: lambda _data: self._models(),
            RECORDINGS.name: lambda _data: RecordingList(schema_version=1, accepted=True),
            ACTIVATE.name: lambda _data: self._models(),
            PUSH_NONCE.name: self._nonce,
            PUSH_BEGIN.name: self._begin,
            PUSH_CHUNK.name: self._chunk,
            PUSH_COMMIT.name: self._commit,
        }
        self._ids = (robot_id, *others)

    def __enter__(self) -> Self:
        settings: dict[str, object] = {
            "mode": "peer",
            "listen/endpoints": [f"tcp/{self.address}"],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "transport/shared_memory/enabled": False,
        }
        configuration = zenoh.Config()
        for key, value in settings.items():
            configuration.insert_json5(key, json.dumps(value))
        self._session = zenoh.open(configuration)
        self._tokens = [
            self._session.liveliness().declare_token(ALIVE.key(name)) for name in self._ids
        ]
        self._queryable = self._session.declare_queryable(
            f"mbot/{self.robot_id}/**", zenoh.handlers.FifoChannel(64)
        )
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._answer, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._session.close()

    def status(self) -> Status:
        return Status(
            schema_version=1,
            robot_id=self.robot_id,
            session_id=SESSION_ID,
            now_monotonic_ns=self.now_ns(),
            state=State.STATE_IDLE,
            board_version="mbot-agent 1",
            board_has_deadman=True,
            decision_rate_hz=10.0,
            active_model=self.active,
            software_version="0.1.0",
            release="0.1.0+7.abcd",
            notices=self.notices,
            trusted_keys=self.trusted_keys,
            accepts_unsigned_models=not self.trusted_keys,
            last_stop=LastStop(count=self.stops),
        )

    def now_ns(self) -> int:
        return time.monotonic_ns() + CLOCK_AHEAD_NS

    def names(self) -> list[str]:
        return [name for name, _data in self.received]

    def commands(self) -> list[Command]:
        names = (COMMAND.name, STOP.name)
        return [Command.FromString(data) for name, data in self.received if name in names]

    def publish(self, message: Decision | CompressedImage | bytes, topic: Topic | None = None):
        if topic is None:
            topic = OBSERVATION if isinstance(message, CompressedImage) else DECISION
        data = message if isinstance(message, bytes) else message.SerializeToString()
        self._session.put(topic.key(self.robot_id), data)

    def _answer(self) -> None:
        while not self._ending.is_set():
            query = self._queryable.try_recv()
            if query is None:
                time.sleep(0.002)
                continue
            with query:
                key = str(query.key_expr)
                name = key.removeprefix(f"mbot/{self.robot_id}/")
                data = b"" if query.payload is None else query.payload.to_bytes()
                self.received.append((name, data))
                reply = self.replies[name](data)
                if isinstance(reply, str):
                    query.reply_err(reply)
                elif reply is not None:
                    raw = reply if isinstance(reply, bytes) else reply.SerializeToString()
                    query.reply(key, raw)

    def _command(self, data: bytes) -> CommandReply:
        command = Command.FromString(data)
        states = {
            "run": State.STATE_RUNNING,
            "drive": State.STATE_MANUAL,
            "stop": State.STATE_STOPPED,
            "mark": State.STATE_RUNNING,
        }
        kind = command.WhichOneof("action")
        reason = ""
        if kind == "stop":
            self.stops += 1
        elif command.expires_monotonic_ns < self.now_ns():
            reason = "it came too late"
        elif command.stop_count != self.stops:
            reason = "stopped by max 0.4 s ago; look, then run again"
        return CommandReply(
            schema_version=1,
            accepted=not reason,
            reason=reason,
            state=states[str(kind)],
            stop_count=self.stops,
            standing=kind == "stop",
        )

    def _models(self) -> ModelList:
        older = Model(
            sha256="b" * 64, name="older", size_bytes=900, previous=True, decision_rate_hz=2.5
        )
        return ModelList(schema_version=1, accepted=True, models=[self.active, older])

    def _nonce(self, _data: bytes) -> PushNonceReply:
        return PushNonceReply(schema_version=1, accepted=True, nonce=NONCE)

    def _begin(self, data: bytes) -> PushReply:
        self.wanted = PushBegin.FromString(data)
        self.staged.clear()
        return PushReply(schema_version=1, accepted=True, push_id="p1")

    def _chunk(self, data: bytes) -> PushReply:
        chunk = PushChunk.FromString(data)
        assert chunk.offset_bytes == len(self.staged)
        self.staged += chunk.data
        return PushReply(schema_version=1, accepted=True, received_bytes=len(self.staged))

    def _commit(self, _data: bytes) -> PushReply:
        self.active = Model(
            sha256=self.wanted.sha256,
            name="new",
            size_bytes=len(self.staged),
            active=True,
            decision_rate_hz=2.5,
        )
        advice = "made for 5 decisions/s"
        return PushReply(schema_version=1, accepted=True, reason=advice, active_model=self.active)
