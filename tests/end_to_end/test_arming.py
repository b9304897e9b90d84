"""Arming over the real link: commands held up by the daemon, and other models."""

import signal
import time

from mbot_protocol.v1.messages_pb2 import Command, CommandReply, Run, Stop
from mbot_protocol.wire.keys import COMMAND, STOP
from mbot_protocol.wire.schema import SCHEMA_VERSION

from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .daemon_watch import Observer
from .processes import Daemon, Process, beats_on, until

FORWARD = constant_model(0.6, 0.6, name="first")
SECOND = constant_model(0.6, 0.5, name="second")
FORWARD_BOARD = (-169, 169)


def test_no_run_from_before_a_stop_moves_the_robot_after_it(
    daemon: Daemon, board: FakeBoard
) -> None:
    """The daemon is held up while both lie there, and may serve them in any order."""
    with daemon.camera(), daemon.start() as process:
        assert daemon.is_up()
        daemon.push(FORWARD)
        assert until(daemon.is_ready)
        with Observer(daemon.address) as observer:
            held_up(board, process, observer)


def held_up(board: FakeBoard, process: Process, observer: Observer) -> None:
    for number in range(10):
        status = observer.status()
        run = Command(
            schema_version=SCHEMA_VERSION,
            robot_id=status.robot_id,
            session_id=status.session_id,
            expires_monotonic_ns=status.now_monotonic_ns + 1_900_000_000,
            stop_count=status.last_stop.count,
            sender_id=7,
            number=number + 1,
            run=Run(),
        )
        stop = Command(schema_version=SCHEMA_VERSION, stop=Stop(), sender="max")
        process.freeze()
        waiting = [
            observer.session.get(topic.key(status.robot_id), payload=data, timeout=10.0)
            for topic, data in (
                (COMMAND, run.SerializeToString()),
                (STOP, stop.SerializeToString()),
            )
        ]
        time.sleep(0.3)
        process.signal(signal.SIGCONT)
        replies = [
            CommandReply.FromString(reply.ok.payload.to_bytes())
            for found in waiting
            for reply in found
            if reply.ok is not None
        ]
        assert any(reply.standing for reply in replies)
        mark = len(board.commands)
        assert beats_on(observer.status, 1)
        assert all(speeds[1:] == (0, 0) for speeds in board.commands[mark:])
        assert observer.status().last_stop.by == "max"


def test_another_model_sets_nothing_in_motion(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.run()  # and waits: there is no model
        daemon.push(FORWARD)
        assert until(daemon.is_ready)
        assert beats_on(daemon.status)
        assert not board.moved
        assert "pushed" in daemon.status().last_stop.why
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD, timeout_s=15)
        daemon.push(SECOND)  # to a robot that drives: it goes on with it
        assert until(lambda: board.speeds not in ((0, 0), FORWARD_BOARD))
