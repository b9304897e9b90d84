"""The network between robot and workstation is cut, frozen or slow, and the robot is driving."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from mbot_protocol.errors import MbotError
from mbot_protocol.wire.keys import STOP
from mbot_workstation.fleet.link.address import parse_address
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.robot_session import open_session
from mbot_workstation.fleet.telemetry.stream import TelemetryStream

from ..promised import promised
from ..reliability.effort import within
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .daemon_watch import Observer
from .network_proxy import NetworkProxy
from .processes import LONGER_THAN_FORGIVEN_S, ROBOT_ID, Daemon, beats_on, until

FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)

LONGER_THAN_THE_LEASE_S = 2.5
"""After 2 s of silence both sides give the link up."""

Record = Callable[[str, object], None]


@pytest.fixture
def network(daemon: Daemon) -> Iterator[NetworkProxy]:
    with NetworkProxy(daemon.address) as network:
        yield network


def drive_alone_no_longer_than_a_second(daemon: Daemon) -> None:
    text = daemon.config.read_text()
    assert "[control]" in text
    setting = '[control]\non_lost_link = "stop"\nlost_link_after_s = 1'
    daemon.config.write_text(text.replace("[control]", setting))


@contextmanager
def driving(daemon: Daemon) -> Iterator[None]:
    """A daemon that is up and has a model."""
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(FORWARD)
        yield


def answers(link: RobotLink) -> bool:
    try:
        return link.status(1.0).robot_id == ROBOT_ID
    except MbotError:
        return False


def test_by_default_the_robot_drives_on_and_misses_nothing(
    daemon: Daemon, board: FakeBoard, network: NetworkProxy, record_property: Record
) -> None:
    with driving(daemon), RobotLink(network.address) as link:
        RemoteControl(link).run(when_ready=True)
        assert board.wait_for(*FORWARD_BOARD)
        with Observer(daemon.address) as observer, TelemetryStream(link, 2.5) as stream:
            assert until(lambda: any(True for _ in stream.poll(0.2)))
            for kind, break_it, bar in (
                ("cut", network.cut, promised("missed-when-cut")),
                ("frozen", network.freeze, promised("missed-when-frozen")),
            ):
                break_it()
                missed = within(bar, lambda: observer.missed_in(LONGER_THAN_THE_LEASE_S))
                record_property(f"{kind}: missed decisions", max(missed))
                assert board.wait_for(*FORWARD_BOARD)
                assert not observer.sees_fault("link-lost")
                network.heal()
                # The same link and the same stream, without anybody's doing.
                assert until(lambda: any(True for _ in stream.poll(0.2)), 20)
                assert until(lambda: answers(link), 20)
        assert RemoteControl(link).stop() == "stopped"
        assert board.wait_for(0, 0)


def test_told_so_the_robot_does_not_drive_alone(
    daemon: Daemon, board: FakeBoard, network: NetworkProxy, record_property: Record
) -> None:
    drive_alone_no_longer_than_a_second(daemon)
    with driving(daemon), RobotLink(network.address) as link, Observer(daemon.address) as observer:
        RemoteControl(link).run(when_ready=True)
        assert board.wait_for(*FORWARD_BOARD)
        time.sleep(LONGER_THAN_THE_LEASE_S)
        assert board.wait_for(*FORWARD_BOARD)  # while somebody is there it drives
        for kind, break_it in (("cut", network.cut), ("frozen", network.freeze)):
            broken_s = time.monotonic()
            break_it()
            # 2 s until the link is given up and 1 s forgiven, with room for a slow machine.
            assert until(lambda: observer.sees_fault("link-lost"), 8)
            assert board.wait_for(0, 0)
            record_property(f"{kind}: stops after s", round(time.monotonic() - broken_s, 2))
            mark = len(board.commands)
            record_property(f"{kind}: missed decisions", observer.missed_in(1.0))
            assert {speeds[1:] for speeds in board.commands[mark:]} == {(0, 0)}
            time.sleep(LONGER_THAN_FORGIVEN_S)
            network.heal()
            assert until(lambda: answers(link), 20)
            assert beats_on(observer.status)
            assert {speeds[1:] for speeds in board.commands[mark:]} == {(0, 0)}
            RemoteControl(link).run(when_ready=True)
            assert board.wait_for(*FORWARD_BOARD, timeout_s=20)


def test_a_command_without_company_starts_what_stops_again(
    daemon: Daemon, board: FakeBoard
) -> None:
    """`workstation run` ends at once: the robot drives for the time it forgives, then stops."""
    drive_alone_no_longer_than_a_second(daemon)
    with driving(daemon):
        time.sleep(1.5)  # nobody is there
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD)
        assert board.wait_for(0, 0, timeout_s=20)


def test_a_slow_network_costs_records_and_neither_decisions_nor_a_stop(
    daemon: Daemon, board: FakeBoard, network: NetworkProxy, record_property: Record
) -> None:
    with driving(daemon), RobotLink(network.address) as link:
        RemoteControl(link).run(when_ready=True)
        assert board.wait_for(*FORWARD_BOARD)
        with (
            Observer(daemon.address) as observer,
            TelemetryStream(link, 2.5) as stream,
            open_session(parse_address(network.address), None) as hand,
        ):
            assert until(lambda: any(True for _ in stream.poll(0.2)))
            network.throttle(2_000)  # a record and its picture have some 3 kB
            record_property("missed decisions", observer.missed_in(LONGER_THAN_THE_LEASE_S))
            asked_s = time.monotonic()
            replies = hand.get(STOP.key(ROBOT_ID), timeout=10.0)
            assert board.wait_for(0, 0, timeout_s=10)
            record_property("stop over 2 kB/s ms", round((time.monotonic() - asked_s) * 1000))
            assert any(reply.ok is not None for reply in replies)
