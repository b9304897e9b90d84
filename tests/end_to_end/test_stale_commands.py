"""A daemon that was asleep (SIGSTOP) finds commands waiting: none that has expired is obeyed."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mbot_protocol.v1.messages_pb2 import Command, CommandReply, Drive, Run, Wheels
from mbot_protocol.wire.keys import COMMAND
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.link.remote_control import RemoteControl

from ..promised import promised
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .daemon_watch import Observer
from .processes import Daemon, Process, beats_on

FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)

TIME_TO_LIVE_NS = 300_000_000
ASLEEP_S = 1.0
"""Longer than the commands live, shorter than the 2 s after which the link would be given up: so
they are all there when the daemon wakes up."""

COMMANDS = 14
"""No more than may wait for the service."""


def test_no_command_older_than_its_expiry_is_obeyed(
    tmp_path: Path, board: FakeBoard, record_property: Callable[[str, object], None]
) -> None:
    daemon = Daemon(tmp_path, board.path)
    with ready(daemon) as process, Observer(daemon.address) as observer:
        status = observer.status()
        process.freeze()
        waiting = [
            observer.session.get(COMMAND.key(status.robot_id), payload=payload, timeout=10.0)
            for payload in late_commands(status.session_id, status.now_monotonic_ns)
        ]
        time.sleep(ASLEEP_S)
        process.signal(signal.SIGCONT)
        replies = [
            CommandReply.FromString(reply.ok.payload.to_bytes())
            for replies in waiting
            for reply in replies
            if reply.ok is not None
        ]
        record_property("commands that arrived late", len(replies))
        obeyed = sum(reply.accepted for reply in replies)
        record_property("obeyed", obeyed)
        assert len(replies) == COMMANDS
        assert obeyed == promised("expired-obeyed")
        assert all("expired" in reply.reason for reply in replies)
        assert beats_on(observer.status, 1)
        assert not board.moved
        # What comes in time is obeyed, so the silence above means something.
        with daemon.link() as link:
            RemoteControl(link).run(when_ready=True)
        assert board.wait_for(*FORWARD_BOARD)


@contextmanager
def ready(daemon: Daemon) -> Iterator[Process]:
    """A daemon that is up and has a model."""
    with daemon.camera(), daemon.start() as process:
        assert daemon.is_up()
        daemon.push(FORWARD)
        yield process


def late_commands(session_id: int, now_ns: int) -> list[bytes]:
    """Orders to run and to drive, valid for 0.3 s."""
    commands: list[Command] = []
    for number in range(COMMANDS):
        command = Command(
            schema_version=SCHEMA_VERSION,
            robot_id="mbot-test",
            session_id=session_id,
            expires_monotonic_ns=now_ns + TIME_TO_LIVE_NS,
        )
        if number % 2:
            command.run.CopyFrom(Run())
        else:
            command.drive.CopyFrom(Drive(wheels=Wheels(left=1, right=1), hold_ms=1000, press=1))
        commands.append(command)
    return [command.SerializeToString() for command in commands]
