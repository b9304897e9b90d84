"""The bridge, heard by a client that speaks Foxglove's websocket protocol."""

import json
import math
import struct
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from typer.testing import CliRunner
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision, State, Wheels
from mbot_workstation.cli.subcommands import app as workstation
from mbot_workstation.fleet.telemetry.stream import Sample
from mbot_workstation.look.drives.driven_path import PathPoint
from mbot_workstation.look.drives.foxglove_bridge import FoxgloveBridge

from .fake_robot import FakeRobot

SUB_PROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1
TIME_NS = 1_800_000_000_123_456_789


def advertised(client: ClientConnection, count: int) -> dict[str, dict[str, Any]]:
    """Channels by topic."""
    found: dict[str, dict[str, Any]] = {}
    while len(found) < count:
        data = client.recv(timeout=10)
        if isinstance(data, str) and (message := json.loads(data)).get("op") == "advertise":
            found |= {channel["topic"]: channel for channel in message["channels"]}
    return found


def subscribed(client: ClientConnection, channels: dict[str, dict[str, Any]]) -> dict[int, str]:
    numbers = {number: topic for number, topic in enumerate(channels, 1)}
    wanted = [{"id": n, "channelId": channels[topic]["id"]} for n, topic in numbers.items()]
    client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    return numbers


@pytest.mark.slow
def test_a_client_subscribes_and_gets_plain_topics() -> None:
    decision = Decision(
        robot_id="mbot-1",
        unix_time_ns=TIME_NS,
        state=State.STATE_RUNNING,
        sequence=7,
        action=Wheels(left=0.5, right=-0.5),
    )
    small, large = CompressedImage(data=b"small", format="jpeg"), CompressedImage(data=b"large")
    for picture in (small, large):
        picture.timestamp.FromNanoseconds(TIME_NS)
    heard: dict[str, list[bytes]] = {}
    with FoxgloveBridge("mbot-1", port=0) as bridge:
        assert bridge.address.startswith("ws://127.0.0.1:")
        with connect(
            bridge.address, subprotocols=[Subprotocol(SUB_PROTOCOL)], proxy=None
        ) as client:
            channels = advertised(client, 5)
            topics = subscribed(client, channels)
            until_s = time.monotonic() + 10
            while len(heard) < 5 and time.monotonic() < until_s:
                for sample in (Sample(decision, 0), Sample(small, 0), Sample(large, 0, True)):
                    bridge.take(sample)
                bridge._before = None
                bridge.take_place(PathPoint(TIME_NS, (1.0, 2.0), math.pi / 2, (0.0, 0.0)))
                try:
                    data = client.recv(timeout=0.05)
                except TimeoutError:
                    continue
                if isinstance(data, bytes) and data[0] == MESSAGE_DATA:
                    number, time_ns = struct.unpack("<IQ", data[1:13])
                    assert time_ns == TIME_NS
                    heard.setdefault(topics[number], []).append(data[13:])
    schemas = {topic: channel["schemaName"] for topic, channel in channels.items()}
    numbers = json.loads(channels["/mbot/mbot-1/drive"]["schema"])
    assert numbers["properties"]["action_left"]["type"] == "number"
    assert schemas["/mbot/mbot-1/observation"] == "foxglove.CompressedImage"
    assert schemas["/mbot/mbot-1/camera"] == "foxglove.CompressedImage"
    assert schemas["/mbot/mbot-1/log"] == "foxglove.Log"
    assert CompressedImage.FromString(heard["/mbot/mbot-1/observation"][0]).data == b"small"
    assert CompressedImage.FromString(heard["/mbot/mbot-1/camera"][0]).data == b"large"
    beat = json.loads(heard["/mbot/mbot-1/drive"][0])
    assert (beat["sequence"], beat["state"], beat["action_left"]) == (7, "running", 0.5)
    pose = PoseInFrame.FromString(heard["/mbot/mbot-1/pose"][0])
    assert (pose.frame_id, pose.pose.position.x, pose.pose.position.y) == ("floor", 1.0, 2.0)
    turned = pose.pose.orientation
    assert (turned.z, turned.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    log = Log.FromString(heard["/mbot/mbot-1/log"][0])
    assert (log.message, log.name, log.level) == ("model none", "mbot-1", Log.INFO)


def test_the_command_names_address_and_layout(
    robot: FakeRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = tmp_path / "path.jsonl"
    path.write_text('{"unix_s": 1.0, "x": 0.5, "y": 0, "yaw": 0, "object": [1, 1, 0]}\n')
    command = ["view", "--foxglove", "--foxglove-port", "0", "--seconds", "0.2", "--map", str(path)]
    result = CliRunner().invoke(workstation, [*command, "--robot", robot.address])
    assert result.exit_code == 0, result.output
    address, layout = (line.rpartition(": ")[2] for line in result.output.splitlines())
    assert address.startswith("ws://127.0.0.1:")
    assert "/mbot/mbot-1/drive" in Path(layout).read_text()


def test_a_taken_port_is_one_line() -> None:
    with FoxgloveBridge("a", port=0) as first:
        port = int(first.address.rpartition(":")[2])
        with pytest.raises(ConfigurationError, match=f"127.0.0.1:{port}"):
            FoxgloveBridge("b", port=port).__enter__()


def test_without_the_library_or_with_a_recording_it_is_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = CliRunner().invoke(workstation, ["view", "drive.mcap", "--foxglove"])
    assert "for a live robot" in str(result.exception)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ConfigurationError, match=r"needs foxglove.*\[foxglove\]"):
        FoxgloveBridge("a")
