"""What takes long, asked for from the console's page: a push, a fetch, a replay."""

import json
import shutil
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from mbot_agent.configuration import Recording
from mbot_agent.recording.recording_directory import RecordingDirectory
from mbot_agent.recording.recording_service import RecordingService
from mbot_protocol.errors import ConfigurationError, ContractError, RefusedError
from mbot_protocol.v1.messages_pb2 import PushReply
from mbot_protocol.wire.keys import PUSH_BEGIN, PUSH_COMMIT
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.look.console.answer_lines import Line, PageGoneError, Tell, in_lines, progress
from mbot_workstation.look.console.long_errands import LongErrands

from ..robot.tiny_models import constant_model
from .fake_robot import ROBOT_ID, FakeRobot

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"
MODEL = constant_model(0.5, 0.5)


@pytest.fixture
def errands(robot: FakeRobot, tmp_path: Path) -> Iterator[LongErrands]:
    with (
        RobotLink(robot.address) as link,
        LongErrands(link, tmp_path, tmp_path / "drives") as made,
    ):
        yield made


@pytest.fixture
def drive(robot: FakeRobot, tmp_path: Path) -> str:
    """A drive on the robot's card, by its name."""
    directory = RecordingDirectory(tmp_path / "card", Recording())
    folder = directory.new_drive()
    shutil.copy(RECORDED / "000.mcap", folder)
    robot.replies.update(RecordingService(ROBOT_ID, directory, enabled=True).answers)
    return folder.name


def test_a_push_tells_how_far_it_is_and_what_the_robot_says(
    errands: LongErrands, robot: FakeRobot
) -> None:
    told: list[Line] = []
    answer = errands.push("my.onnx", MODEL, told.append)
    assert bytes(robot.staged) == MODEL
    assert answer["done"]
    assert answer["words"].startswith("new ")
    assert "is active, unsigned" in answer["words"]
    assert "the robot finds: made for 5 decisions/s" in answer["words"]
    shares = [line["share"] for line in told if line["kind"] == "progress"]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert told[-1]["kind"] == "models"


def test_a_push_that_the_robot_refuses_says_its_reason(
    errands: LongErrands, robot: FakeRobot
) -> None:
    reply = PushReply(schema_version=1, reason="its signature is not right")
    robot.replies[PUSH_BEGIN.name] = lambda _data: reply
    with pytest.raises(RefusedError, match="keeps its own: its signature is not right"):
        errands.push("my.onnx", MODEL, lambda _line: None)
    with pytest.raises(ContractError, match=r"^my\.onnx: this is not an ONNX model"):
        errands.push("my.onnx", b"text", lambda _line: None)


def test_a_page_that_is_gone_makes_nothing_active(errands: LongErrands, robot: FakeRobot) -> None:
    def gone(_line: Line) -> None:
        raise PageGoneError

    with pytest.raises(PageGoneError):
        errands.push("my.onnx", MODEL, gone)
    assert PUSH_COMMIT.name not in robot.names()


def test_a_drive_is_fetched_and_decided_again(
    errands: LongErrands, drive: str, tmp_path: Path
) -> None:
    told: list[Line] = []
    answer = errands.fetch(drive, told.append)
    assert (tmp_path / "drives" / ROBOT_ID / drive / "000.mcap").exists()
    assert str(tmp_path) in answer["words"]
    assert told[-1] == progress("fetching", 1, 1)
    with pytest.raises(ConfigurationError, match="name it, or one to compare with"):
        errands.replay(drive, b"", told.append)
    shutil.copy(RECORDED / "seeing.onnx", tmp_path)
    found = errands.replay(drive, b"", told.append)
    assert found["kind"] == "replay"
    assert any("12 decisions" in line for line in found["lines"])
    assert told[-1] == progress("deciding again", 12, 12)
    other = errands.replay(drive, MODEL, told.append)
    assert other["done"]
    assert len(other["rows"]) > 0
    time_s, _beat, then, now, differs = other["rows"][0]
    assert time_s.endswith(" s")
    assert now == "+0.500 +0.500"
    left, right = (float(value) for value in then.split())
    assert float(differs) == pytest.approx(max(abs(0.5 - left), abs(0.5 - right)), abs=0.05)


def test_a_model_sent_from_the_page_decides_its_own_drives_again(
    errands: LongErrands, drive: str
) -> None:
    errands.push("seeing.onnx", (RECORDED / "seeing.onnx").read_bytes(), lambda _line: None)
    assert any(
        "the model that drove" in line for line in errands.replay(drive, b"", print)["lines"]
    )


def test_only_what_the_robot_lists_is_fetched(errands: LongErrands, drive: str) -> None:
    for name in ("", "drive-9999-20261122-171501", "../../etc"):
        with pytest.raises(ConfigurationError, match="keeps no recording"):
            errands.fetch(name, lambda _line: None)


def asked(
    work: Any, *, hang_up_after: int | None = None, ended: threading.Event | None = None
) -> list[Line]:
    """What a page hears of this work; it may go after so many lines, and the server stays on."""
    pool = ThreadPoolExecutor(1)

    async def answer(_: Request) -> Response:
        return in_lines(pool, work, {})

    heard: list[Line] = []
    gone = anyio.Event()

    async def receive() -> dict[str, Any]:
        if heard or hang_up_after != 0:
            await gone.wait()
        return {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        body = message.get("body", b"")
        heard.extend(json.loads(line) for line in body.splitlines())
        if len(heard) == hang_up_after:
            gone.set()

    async def ask() -> None:
        app = Starlette(routes=[Route("/", answer)])
        scope = {"type": "http", "method": "GET", "path": "/", "headers": [], "query_string": b""}
        await app(scope, receive, send)
        if ended is not None:
            await anyio.to_thread.run_sync(ended.wait, 10)
            heard.append({"ended": ended.is_set()})

    anyio.run(ask)
    pool.shutdown()
    return heard


def test_lines_come_in_their_order_and_the_last_says_what_came_of_it() -> None:
    def work(tell: Tell) -> Line:
        tell(progress("counting", 1, 2))
        return {"kind": "answer", "done": True, "words": "counted"}

    assert [line["kind"] for line in asked(work)] == ["progress", "answer"]


def test_what_goes_wrong_is_the_last_line() -> None:
    def refused(_tell: Tell) -> Line:
        raise RefusedError("not for you")

    def broken(_tell: Tell) -> Line:
        raise ZeroDivisionError("a mistake")

    assert asked(refused) == [{"kind": "answer", "done": False, "words": "not for you"}]
    assert asked(broken)[-1]["words"] == "internal error: a mistake"


def test_work_ends_with_the_page() -> None:
    ended = threading.Event()

    def endless(tell: Tell) -> Line:
        give_up_s = time.monotonic() + 20
        try:
            while time.monotonic() < give_up_s:
                tell(progress("counting", 1, 2))
                time.sleep(0.001)
        except PageGoneError:
            ended.set()
            raise
        return {}

    assert asked(endless, hang_up_after=3, ended=ended)[-1] == {"ended": True}
