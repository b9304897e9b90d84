"""STOP by the robot's own link, and the threads that obey and confirm it."""

import threading
import time
from collections.abc import Iterator

import pytest
import zenoh

from mbot_agent.arming import Mode, Orders
from mbot_agent.commands.stop_service import PULSE, StopService
from mbot_agent.configuration import Configuration, Network
from mbot_agent.helm import Helm
from mbot_agent.network.zenoh_link import Link
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire import keys
from mbot_workstation.fleet.link.address import parse_address
from mbot_workstation.fleet.link.robot_session import open_session

from ..free_port import free_port
from ..until import until
from .loop_bench import ObedientBoard

SENT = messages.Command(sender="max").SerializeToString()


class SlowBoard(ObedientBoard):
    """Confirms a stop when the test says so.

    Attributes:
        looks: how often it was asked.

    """

    def __init__(self) -> None:
        super().__init__()
        self.confirms = threading.Event()
        self.confirms.set()
        self.looks = 0

    def stands(self, timeout_s: float) -> bool:
        self.looks += 1
        self.confirms.wait(10)
        return super().stands(timeout_s)


class Robot:
    """A robot that runs and can be stopped, and somebody who does."""

    def __init__(self, link: Link, session: zenoh.Session) -> None:
        self.link = link
        self.board = SlowBoard()
        self.helm = Helm(self.board, Orders(Mode.RUNNING))
        self.service = StopService(self.helm, self.board)
        self.service.serve(link)
        self._session = session
        self.replies: list[messages.CommandReply] = []

    def stop(self) -> None:
        for reply in self._session.get(keys.STOP.key("mbot-1"), payload=SENT, timeout=10.0):
            assert reply.ok is not None
            self.replies.append(messages.CommandReply.FromString(reply.ok.payload.to_bytes()))

    def stops(self, number: int) -> list[threading.Thread]:
        asking = [threading.Thread(target=self.stop) for _ in range(number)]
        for one in asking:
            one.start()
        return asking

    def silent_ms(self) -> float:
        return (time.monotonic_ns() - self.service.progress_ns) / 1e6


@pytest.fixture
def robot() -> Iterator[Robot]:
    port = free_port()
    configuration = Configuration(
        robot_id="mbot-1", network=Network(listen=(f"tcp/127.0.0.1:{port}",))
    )
    with (
        Link(configuration) as link,
        open_session(parse_address(f"127.0.0.1:{port}"), None) as session,
    ):
        yield Robot(link, session)


def test_a_stop_is_obeyed_and_confirmed(robot: Robot) -> None:
    robot.stop()
    [reply] = robot.replies
    assert (reply.accepted, reply.standing, reply.stop_count) == (True, True, 2)
    assert (robot.helm.orders.mode, robot.helm.orders.stop.by) == (Mode.STOPPED, "max")
    assert robot.board.looks == 1


def test_the_daemon_hears_itself(robot: Robot) -> None:
    assert robot.link.answers(PULSE, 5.0)
    assert robot.helm.orders.mode is Mode.RUNNING


def test_stops_that_wait_are_confirmed_together(robot: Robot) -> None:
    """Each look takes the board 12 ms of wire: a flood must not keep somebody else waiting."""
    robot.board.confirms.clear()
    first = robot.stops(1)
    assert until(lambda: robot.board.looks == 1)
    others = robot.stops(8)
    assert until(lambda: robot.helm.orders.stop.count == 1 + 9), "acted on before any is confirmed"
    robot.board.confirms.set()
    for one in first + others:
        one.join()
    assert robot.board.looks == 2
    assert [reply.standing for reply in robot.replies] == [True] * 9


def test_nobody_asks_a_board_that_nobody_stops(robot: Robot) -> None:
    robot.stop()
    time.sleep(0.1)
    assert robot.board.looks == 1


def test_the_watchdog_sees_a_confirmation_that_hangs(robot: Robot) -> None:
    assert until(lambda: robot.silent_ms() < 100, 5)
    robot.board.confirms.clear()
    asking = robot.stops(1)
    assert until(lambda: robot.silent_ms() > 300, 5)
    robot.board.confirms.set()
    asking[0].join()
    assert until(lambda: robot.silent_ms() < 100, 5)


def test_the_watchdog_sees_a_stop_that_hangs(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    go_on = threading.Event()
    monkeypatch.setattr(robot.helm, "stop", lambda _by: go_on.wait(10))
    asking = robot.stops(1)
    assert until(lambda: robot.silent_ms() > 300, 5)
    go_on.set()
    asking[0].join()
    assert until(lambda: robot.silent_ms() < 100, 5)


def test_a_service_that_is_not_served_yet_hangs_nowhere() -> None:
    board = ObedientBoard()
    service = StopService(Helm(board, Orders(Mode.IDLE)), board)
    assert time.monotonic_ns() - service.progress_ns < 10**8
