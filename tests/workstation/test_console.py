"""The console's server on a real socket, with a scripted robot behind it."""

import http.client
import json
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from typer.testing import CliRunner
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES
from mbot_protocol.v1.messages_pb2 import (
    Decision,
    Fault,
    LastStop,
    Model,
    Notice,
    State,
    Status,
    Steps,
    Wheels,
)
from mbot_protocol.v1.recordings_pb2 import ListedDrive, ListedFile, RecordingList
from mbot_protocol.wire.keys import CAMERA, MODELS, OBSERVATION, PUSH_BEGIN, RECORDINGS
from mbot_workstation.cli.driving import ConsoleOptions
from mbot_workstation.cli.subcommands import app as workstation
from mbot_workstation.fleet.by_hand import hand
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.telemetry.window import TelemetryWindow
from mbot_workstation.look.console.console_app import PAGE_FILES, Console
from mbot_workstation.look.console.console_server import listen, serve
from mbot_workstation.look.console.door import Door
from mbot_workstation.look.console.errands import PASSPHRASE_VARIABLE, Errands
from mbot_workstation.look.console.page_messages import GoBack
from mbot_workstation.look.console.page_state import page_state
from mbot_workstation.look.console.robot_watch import RobotWatch

from ..robot.tiny_models import constant_model
from ..until import until
from .fake_robot import FakeRobot
from .hand_driven import hand_driven

TOKEN = "a-token-for-tests"


@dataclass
class Served:
    port: int

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    def ask(self, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        connection.request(method, path, body or None, headers={"Host": self.host, **headers})
        reply = connection.getresponse()
        found = reply.status, reply.read().decode()
        assert "default-src 'none'" in reply.headers.get(
            "Content-Security-Policy", "default-src 'none'"
        )
        connection.close()
        return found

    def live(self, token: str = TOKEN, origin: str | None = None) -> ClientConnection:
        where = f"ws://{self.host}/{token}/live"
        return connect(where, origin=Origin(origin or f"http://{self.host}"), proxy=None)


@pytest.fixture
def served(robot: FakeRobot, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    servers: list[uvicorn.Server] = []
    begin = uvicorn.Server.__init__
    monkeypatch.setattr(
        uvicorn.Server, "__init__", lambda self, c: servers.append(self) or begin(self, c)
    )
    ready = threading.Event()
    with (
        listen(0) as listener,
        RobotLink(robot.address) as link,
        Console(link, Door(TOKEN)) as made,
    ):
        thread = threading.Thread(target=serve, args=(made.app, listener, ready.set))
        thread.start()
        assert ready.wait(10)
        yield Served(listener.getsockname()[1])
        servers[0].should_exit = True
        thread.join(10)
        assert not thread.is_alive()


def hear(socket: ClientConnection, kind: str, **wanted: Any) -> dict[str, Any]:
    """The next message of that kind, with these values in it."""
    until_s = time.monotonic() + 10
    while time.monotonic() < until_s:
        data = socket.recv(timeout=10)
        message = json.loads(data) if isinstance(data, str) else {}
        if message.get("kind") == kind and all(message.get(k) == v for k, v in wanted.items()):
            return message
    raise AssertionError(f"no {kind} {wanted}")


def say(socket: ClientConnection, **message: Any) -> None:
    socket.send(json.dumps(message))


def test_the_page_is_for_who_has_the_address(served: Served) -> None:
    for name in PAGE_FILES:
        code, text = served.ask("GET", f"/{TOKEN}/{name}")
        assert code == 200
        assert text
        assert "http://" not in text.replace("http://www.w3.org", "")
        assert "https://" not in text, "it works without the internet"
        assert served.ask("GET", f"/wrong/{name}")[0] == 403
        assert served.ask("GET", f"/{TOKEN}/{name}", Host="evil.example")[0] == 403
    assert served.ask("GET", f"/{TOKEN}/../door.py")[0] == 404
    assert served.ask("GET", "/")[0] == 403


def test_fetched_drives_are_looked_through_on_a_page_of_their_own(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, text = served.ask("GET", f"/{TOKEN}/drives")
    assert (code, "recordings fetch" in text) == (404, True)
    hand_driven(tmp_path / "drives" / "mbot-1" / "drive-0001")
    code, text = served.ask("GET", f"/{TOKEN}/drives")
    assert (code, "1 drives" in text) == (200, True)
    said = b'{"drive": "mbot-1/drive-0001", "verdict": "drop"}'
    assert served.ask("POST", f"/{TOKEN}/review", said, Origin="http://evil.example")[0] == 403
    assert served.ask("GET", "/wrong/drives")[0] == 403
    assert not list(tmp_path.rglob("*.review.json"))
    for body, done in ((b"{}", False), (said, True)):
        code, text = served.ask("POST", f"/{TOKEN}/review", body, Origin=f"http://{served.host}")
        assert (code, json.loads(text)["done"]) == (200, done)
    assert len(list(tmp_path.rglob("*.review.json"))) == 1
    too_much = served.ask("POST", f"/{TOKEN}/review", b"x" * 5000, Origin=f"http://{served.host}")
    assert too_much[0] == 413


@pytest.mark.parametrize("token", ["wrong", "", TOKEN + "x"])
def test_no_websocket_without_the_token(served: Served, token: str) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        served.live(token)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_no_websocket_and_no_stop_for_another_sites_page(served: Served, origin: str) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        served.live(origin=origin)
    assert served.ask("POST", f"/{TOKEN}/stop", Origin=origin)[0] == 403
    assert served.ask("POST", f"/{TOKEN}/stop")[0] == 403


def test_stop_needs_nothing_but_a_request(served: Served, robot: FakeRobot) -> None:
    code, text = served.ask("POST", f"/{TOKEN}/stop", Origin=f"http://{served.host}")
    assert code == 200
    assert json.loads(text)["done"]
    assert "confirmed" in json.loads(text)["words"]
    assert robot.stops == 2


def test_run_names_the_stop_that_the_page_shows(served: Served, robot: FakeRobot) -> None:
    with served.live() as socket:
        seen = hear(socket, "state", lost="")["stop_count"]
        robot.stops += 1  # somebody else
        say(socket, do="run", seen_stops=seen)
        assert "do it again" in hear(socket, "answer", done=False)["words"]
        assert not [c for c in robot.commands() if c.HasField("run")]
        say(socket, do="run", seen_stops=robot.stops)
        assert hear(socket, "answer", done=True)["words"] == "run: running"


def test_the_page_marks_what_was_wrong(served: Served, robot: FakeRobot) -> None:
    with served.live() as socket:
        say(socket, do="mark")
        assert "3 s until now were wrong" in hear(socket, "answer", done=True)["words"]
    assert robot.commands()[-1].mark.back_ms == 3000


def test_a_hand_drives_while_it_repeats_and_a_closed_page_lets_go(
    served: Served, robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hand, "FRESH_S", 60.0)  # at once, and not because nothing comes any more
    with served.live() as socket:
        for beat in range(5):
            message = {"left": 0.4, "right": -0.4, "seen_stops": robot.stops, "sent_s": beat / 10}
            say(socket, do="hand", press=1, **message)
            time.sleep(0.1)
    assert until(lambda: robot.commands()[-1].drive.hold_ms == 1)


def test_who_drives_by_this_page_is_told_so_and_another_page_is_told_the_name(
    served: Served, robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    def driven() -> Status:
        status = robot.status()
        status.state = State.STATE_MANUAL
        return status

    monkeypatch.setattr(hand, "FRESH_S", 60.0)
    robot.replies["status"] = lambda _data: driven()
    with served.live() as socket, served.live() as other:
        say(socket, do="hand", press=1, left=0.4, right=0.4, seen_stops=robot.stops, sent_s=0.0)
        assert hear(socket, "state", headline="You drive by hand")
        assert hear(other, "state", state="manual")["headline"].startswith("Driven by hand")
        say(socket, do="let-go", press=1)
        assert hear(socket, "state", headline="Driven by hand")


def test_a_stop_by_somebody_else_ends_the_hands_drive(served: Served, robot: FakeRobot) -> None:
    message = {"press": 1, "left": 0.4, "right": 0.4, "seen_stops": robot.stops}
    with served.live() as socket:
        say(socket, do="hand", sent_s=0, **message)
        assert until(robot.commands)
        robot.stops += 1
        say(socket, do="hand", sent_s=0.1, **message)
        assert "stopped by max" in hear(socket, "hand-ended")["words"]
        say(socket, do="hand", sent_s=0.2, **message)
        assert "let go" in hear(socket, "hand-ended")["words"]


def test_nonsense_closes_the_connection_and_nothing_else(served: Served) -> None:
    with served.live() as socket:
        socket.send("nonsense")
        with pytest.raises(ConnectionClosed):
            hear(socket, "never")
    with served.live() as socket:
        socket.send(b"bytes")
        with pytest.raises(ConnectionClosed):
            hear(socket, "never")
    with served.live() as socket:
        assert hear(socket, "state")["robot"] == "mbot-1"


def test_pictures_of_both_eyes_reach_the_page(served: Served, robot: FakeRobot) -> None:
    with served.live() as socket:
        hear(socket, "state", lost="")
        seen: dict[bytes, bytes] = {}
        until_s = time.monotonic() + 10
        while len(seen) < 2 and time.monotonic() < until_s:
            robot.publish(CompressedImage(data=b"small"), OBSERVATION)
            robot.publish(CompressedImage(data=b"large"), CAMERA)
            data = socket.recv(timeout=10)
            if isinstance(data, bytes):
                seen[data[:1]] = data[1:]
    assert seen == {b"p": b"small", b"c": b"large"}


def test_models_and_recordings_are_listed(served: Served, robot: FakeRobot) -> None:
    drive = ListedDrive(
        name="drive-0001-20261122-171501",
        files=[ListedFile(name="000.mcap", size_bytes=2_500_000)],
        started_unix_time_ns=5_000_000_000,
        ended_unix_time_ns=47_000_000_000,
    )
    robot.replies[RECORDINGS.name] = lambda _data: RecordingList(
        schema_version=1, accepted=True, enabled=True, drives=[drive], free_bytes=10**10
    )
    with served.live() as socket:
        say(socket, do="models")
        names = [model["name"] for model in hear(socket, "models")["models"]]
        assert names == ["old", "older"]
        say(socket, do="recordings")
        (found,) = hear(socket, "recordings")["drives"]
        assert (found["name"], found["lasted_s"], found["size"]) == (drive.name, 42, "2.50 MB")
        robot.replies[MODELS.name] = lambda _data: "not for you"
        say(socket, do="models")
        assert "not for you" in hear(socket, "answer", done=False)["words"]


def test_a_model_is_sent_from_the_page_and_not_from_another(
    served: Served, robot: FakeRobot
) -> None:
    model = constant_model(0.5, 0.5)
    origin = {"Origin": f"http://{served.host}"}
    path = f"/{TOKEN}/push?name=my.onnx"
    assert served.ask("POST", path, model, Origin="http://elsewhere")[0] == 403
    assert served.ask("POST", "/another-token/push", model, **origin)[0] == 403
    code, words = served.ask("POST", path, bytes(LARGEST_MODEL_BYTES + 1), **origin)
    assert (code, "more than" in words) == (413, True)
    assert PUSH_BEGIN.name not in robot.names()
    code, text = served.ask("POST", path, model, **origin)
    assert code == 200
    lines = [json.loads(line) for line in text.splitlines()]
    assert bytes(robot.staged) == model
    assert [line["kind"] for line in lines[-2:]] == ["models", "answer"]
    robot.replies[RECORDINGS.name] = lambda _data: RecordingList(schema_version=1, accepted=True)
    for name in ("fetch", "replay"):
        text = served.ask("POST", f"/{TOKEN}/{name}?drive=none", b"", **origin)[1]
        assert "keeps no recording" in json.loads(text)["words"]


def test_a_key_with_a_passphrase_is_named_and_not_asked_for(
    robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mbot_workstation.look.console import errands

    monkeypatch.delenv(PASSPHRASE_VARIABLE, raising=False)
    with pytest.raises(ConfigurationError, match=PASSPHRASE_VARIABLE):
        errands._passphrase("anna")
    monkeypatch.setenv(PASSPHRASE_VARIABLE, "secret")
    assert errands._passphrase("anna") == "secret"
    with RobotLink(robot.address) as link:  # this one takes unsigned models
        assert Errands(link).carry_out(GoBack(sha256="b" * 64))["kind"] == "models"


def shown(status: Status | None, **given: Any) -> dict[str, Any]:
    given = {"silence_s": 0.1, "problem": "", **given}
    return dict(page_state("mbot-1", status, TelemetryWindow(), **given))


def test_each_state_is_told_in_words() -> None:
    stop = LastStop(count=4, by="max", monotonic_ns=1_000_000_000)
    status = Status(state=State.STATE_STOPPED, last_stop=stop, now_monotonic_ns=1_400_000_000)
    assert shown(status)["headline"] == "Standing, stopped by max 0.4 s ago"
    assert shown(status)["stop_count"] == 4
    stop.why, stop.by = "the picture stands still", ""
    status = Status(state=State.STATE_STOPPED, last_stop=stop, now_monotonic_ns=61_000_000_000)
    assert shown(status)["headline"] == "Standing, stopped 60 s ago (the picture stands still)"
    status.let_go_monotonic_ns = 60_000_000_000
    assert shown(status)["headline"] == "Standing, the hand let go 1.0 s ago"
    assert "the picture stands still" in shown(status)["stop_words"], "of the last stop, as ever"
    heads = {shown(Status(state=State.Name(state)))["headline"] for state in State.values()}
    assert len(heads) == len(State.values())


def test_wheels_are_shown_whoever_turns_them() -> None:
    window = TelemetryWindow()
    for decision, wheels in (
        (Decision(steps=Steps(left=125, right=-250)), (0.5, -1.0)),  # a robot of before
        (Decision(duty=Wheels(left=0.4, right=0.3)), (0.4, 0.3)),  # a hand: no policy, no steps
    ):
        window.newest = decision
        state = page_state("mbot-1", Status(), window, silence_s=0.1, problem="")
        told = state["wheels"]
        assert isinstance(told, dict)
        assert (told["left"], told["right"]) == pytest.approx(wheels)


def test_it_is_said_whose_hand_drives() -> None:
    window = TelemetryWindow()
    window.newest = Decision(driven_by="anna@desk")
    state = page_state(
        "mbot-1", Status(state=State.STATE_MANUAL), window, silence_s=0.1, problem=""
    )
    assert state["headline"] == "Driven by hand by anna@desk"


def test_run_is_refused_with_the_reason() -> None:
    assert shown(Status(state=State.STATE_STOPPED))["run_refused"] == ""
    assert "already" in str(shown(Status(state=State.STATE_RUNNING))["run_refused"])
    fault = Fault(kind="no-model", detail="no model: push one")
    status = Status(
        state=State.STATE_IDLE,
        faults=[fault],
        notices=[Notice(kind="a", detail="b")],
        active_model=Model(sha256="ab" * 32, name="cube"),
    )
    assert shown(status)["run_refused"] == "no model: push one"
    assert shown(status)["faults"] == ["no-model: no model: push one"]
    assert shown(status)["notices"] == ["a: b"]
    assert shown(status)["on_trial"]


def test_what_is_old_is_called_old() -> None:
    assert shown(None, problem="nobody there")["lost"] == "nobody there"
    old = shown(Status(state=State.STATE_RUNNING), silence_s=3.0)
    assert old["state"] == "unknown"
    assert old["lost"] == "no answer from the robot since 3.0 s"
    assert old["run_refused"]


def test_a_robot_that_is_gone_is_said_to_be(robot: FakeRobot) -> None:
    with RobotLink(robot.address) as link, RobotWatch(link) as watch:
        assert until(lambda: watch.view().state["lost"] == "")
        robot.__exit__()
        assert until(lambda: watch.view().state["lost"])
        robot.__enter__()


def test_a_taken_port_and_two_robots_are_one_line() -> None:
    with (
        listen(0) as taken,
        pytest.raises(ConfigurationError, match="another console running"),
    ):
        listen(taken.getsockname()[1])
    result = CliRunner().invoke(workstation, ["console", "here", "--robot", "there"])
    assert isinstance(result.exception, ConfigurationError)
    assert "give one of them" in str(result.exception)
    assert ConsoleOptions().browser
