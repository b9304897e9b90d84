"""The daemon under malformed, giant and never-read messages, and too many connections."""

import json
import select
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from mbot_agent.configuration import Configuration, Network
from mbot_agent.network.zenoh_link import Link
from mbot_agent.network.zenoh_settings import MOST_PENDING, MOST_SESSIONS
from mbot_protocol.errors import UnreachableError
from mbot_protocol.wire.keys import COMMAND, OBSERVATION, PUSH_CHUNK, TOPICS, Flow, Topic
from mbot_workstation.fleet.link.address import parse_address
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_session import open_session

from ..free_port import free_port
from ..promised import promised
from ..reliability.effort import within
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .daemon_watch import Observer, PeakMemory, accepted_connections, resident_mb
from .fleet import LOCALHOST, Fleet
from .processes import HERE, ROBOT_ID, Daemon, Process, freeze, until, workstation

QUERIES = [topic for topic in TOPICS if topic.flow is Flow.QUERY]
FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)

MALFORMED = 1000
"""On every key."""

GIANT_BYTES = 64 << 20

SILENT = 40
"""Connections that nothing comes over."""

Record = Callable[[str, object], None]


@pytest.fixture
def running(daemon: Daemon) -> Iterator[Process]:
    with daemon.camera(), daemon.start() as process:
        assert daemon.is_up()
        daemon.push(FORWARD)
        yield process


def test_malformed_messages_are_refused_and_a_stop_gets_through(
    daemon: Daemon, running: Process, tmp_path: Path, record_property: Record
) -> None:
    stops_ms: list[float] = []
    with Observer(daemon.address) as observer, daemon.link() as link:
        before_mb = resident_mb(running.pid)

        def worst_ms() -> float:
            known = len(stops_ms)
            program = str(HERE / "malformed_fire.py"), daemon.address, ROBOT_ID, str(MALFORMED)
            with Process(sys.executable, *program, log=tmp_path / f"fire-{known}.log") as fire:
                while fire.is_running():
                    asked_s = time.monotonic()
                    assert RemoteControl(link).stop() == "stopped"
                    stops_ms.append((time.monotonic() - asked_s) * 1000)
                    time.sleep(0.05)
            answered = json.loads(fire.output)
            assert answered.keys() == {topic.name for topic in QUERIES}
            assert min(answered.values()) >= MALFORMED, answered
            assert len(stops_ms) > known + 5
            return max(stops_ms[known:])

        worst = within(promised("stop-malformed-worst"), worst_ms)
        growth_mb = resident_mb(running.pid) - before_mb
        record_property("messages", MALFORMED * len(QUERIES))
        record_property("stops meanwhile", len(stops_ms))
        record_property("stop p50 ms", round(statistics.median(stops_ms), 1))
        record_property("stop worst ms", round(max(worst), 1))
        record_property("memory MB", round(growth_mb, 1))
        assert statistics.median(stops_ms) <= promised("stop-malformed-median")
        assert growth_mb <= promised("malformed-memory")
        assert running.is_running()
        assert observer.status().active_model.name == "constant"
    assert "Traceback" not in daemon.log.read_text()


@pytest.mark.parametrize("topic", [COMMAND, PUSH_CHUNK], ids=lambda topic: topic.name)
def test_a_giant_payload_is_never_put_together(
    daemon: Daemon, running: Process, topic: Topic, record_property: Record
) -> None:
    with Observer(daemon.address) as observer, daemon.link() as link:
        with PeakMemory(running.pid) as memory:
            payload = bytes(GIANT_BYTES)
            replies = observer.session.get(topic.key(ROBOT_ID), payload=payload, timeout=2.0)
            assert RemoteControl(link).stop() == "stopped"
            assert [reply for reply in replies if reply.ok is not None] == []
        record_property("memory MB", round(memory.growth_mb, 1))
        assert memory.growth_mb <= promised("giant-memory")
        assert running.is_running()
        assert link.status().robot_id == ROBOT_ID


def test_a_request_just_over_its_limit_never_reaches_the_daemon(
    daemon: Daemon, running: Process
) -> None:
    with Observer(daemon.address) as observer:
        for topic in QUERIES:
            for size_bytes, answers in ((topic.largest_bytes, 1), (topic.largest_bytes + 1, 0)):
                payload = b"\xff" * size_bytes
                replies = list(
                    observer.session.get(topic.key(ROBOT_ID), payload=payload, timeout=5.0)
                )
                found = [reply for reply in replies if reply.ok is not None]
                assert len(found) == answers, (topic.name, size_bytes)
    assert running.is_running()


SUBSCRIBER = """
import json, sys, time, zenoh
config = zenoh.Config()
for key, value in {"mode": "client", "connect/endpoints": [sys.argv[1]],
                   "scouting/multicast/enabled": False}.items():
    config.insert_json5(key, json.dumps(value))
with zenoh.open(config) as session:
    samples = session.declare_subscriber(sys.argv[2], zenoh.handlers.RingChannel(4))
    samples.recv()
    print("hears", flush=True)
    time.sleep(600)
"""


def test_a_subscriber_that_stopped_reading_holds_nobody_up(record_property: Record) -> None:
    """Its lease is Zenoh's own 10 s, so the link to it stands, full, for as long as this takes."""
    endpoint = f"tcp/{LOCALHOST}:{free_port()}"
    configuration = Configuration(robot_id="mbot-1", network=Network(listen=(endpoint,)))
    command = [sys.executable, "-c", SUBSCRIBER, endpoint, OBSERVATION.key("mbot-1")]
    with (
        Link(configuration) as link,
        subprocess.Popen(command, stdout=subprocess.PIPE) as subscriber,
    ):
        try:
            assert subscriber.stdout is not None
            payload = bytes(20_000)
            while not select.select([subscriber.stdout], [], [], 0.05)[0]:
                link.publish(OBSERVATION, payload)
            assert subscriber.stdout.readline() == b"hears\n"
            freeze(subscriber.pid)
            took_ms: list[float] = []
            for _ in range(1000):  # 20 MB: more than all buffers on the way hold
                began_s = time.perf_counter()
                link.publish(OBSERVATION, payload)
                took_ms.append((time.perf_counter() - began_s) * 1000)
        finally:
            subscriber.kill()
    p99_ms = statistics.quantiles(took_ms, n=100)[98]
    record_property("publish p50 ms", round(statistics.median(took_ms), 3))
    record_property("publish p99 ms", round(p99_ms, 2))
    record_property("publish worst ms", round(max(took_ms), 1))
    # If the link were waited for, one would take 5 s.
    assert p99_ms <= promised("published")


def test_frozen_watchers_cost_no_decision(
    daemon: Daemon, board: FakeBoard, running: Process, tmp_path: Path, record_property: Record
) -> None:
    with ExitStack() as stack, Observer(daemon.address) as observer, daemon.link() as link:
        watchers = [
            stack.enter_context(
                workstation("telemetry", "--robot", daemon.address, log=tmp_path / f"{number}.log")
            )
            for number in range(2)
        ]
        assert until(lambda: all(watcher.output for watcher in watchers), 30)
        RemoteControl(link).run(when_ready=True)
        assert board.wait_for(*FORWARD_BOARD)
        for watcher in watchers:
            watcher.freeze()
        record_property("missed decisions", observer.missed_in(3.0))
        assert board.wait_for(*FORWARD_BOARD)
        assert RemoteControl(link).stop() == "stopped"
    assert running.is_running()


@pytest.fixture
def enrolled(tmp_path: Path, board: FakeBoard) -> tuple[Daemon, Fleet]:
    """A daemon that takes certificates, and the fleet it belongs to."""
    daemon = Daemon(tmp_path, board.path)
    fleet = Fleet(tmp_path / "fleet")
    fleet.enrol(ROBOT_ID)
    daemon.address = f"{LOCALHOST}:{fleet.ports[ROBOT_ID]}"
    (tmp_path / "enrolment.toml").write_text(fleet.enrolment_text(ROBOT_ID))
    return daemon, fleet


def test_strangers_who_connect_and_say_nothing_are_shown_the_door(
    enrolled: tuple[Daemon, Fleet], record_property: Record
) -> None:
    """Zenoh shows out ten a second, and lets nobody new in meanwhile; who is in stays in."""
    daemon, fleet = enrolled
    me = fleet.folder.roll().me
    with daemon.camera(), daemon.start() as process, ExitStack() as stack:
        assert daemon.is_up()
        link = stack.enter_context(fleet.link(ROBOT_ID, me))
        before_mb = resident_mb(process.pid)
        host, port = daemon.address.split(":")
        # Not its files: the daemon opens some for moments. Who asked whether it is up may still go.
        assert until(lambda: accepted_connections(int(port)) == 1)
        for _ in range(SILENT):
            stack.enter_context(socket.create_connection((host, int(port)), timeout=10))
        assert until(lambda: accepted_connections(int(port)) == 1 + SILENT)

        def are_out() -> bool:
            assert RemoteControl(link).stop() == "stopped"
            return accepted_connections(int(port)) == 1

        assert until(are_out, 12)  # 3 s and 40 times 0.1; with Zenoh's own 10 s it would be 14
        growth_mb = resident_mb(process.pid) - before_mb
        record_property("silent connections", SILENT)
        record_property("memory MB", round(growth_mb, 1))
        assert growth_mb <= 16
        with fleet.link(ROBOT_ID, me) as another:
            assert another.status().robot_id == ROBOT_ID
        assert process.is_running()


def test_only_some_may_say_nothing_at_a_time_and_not_for_long() -> None:
    """Zenoh's own limits are 100 at a time and 10 s; without TLS it is all there is."""
    port = free_port()
    network = Network(listen=(f"tcp/{LOCALHOST}:{port}",))
    with Link(Configuration(robot_id="mbot-1", network=network)), ExitStack() as stack:
        for _ in range(3 * MOST_PENDING):
            stack.enter_context(socket.create_connection((LOCALHOST, port), timeout=10))
        assert MOST_PENDING == 8
        assert until(lambda: accepted_connections(port) == MOST_PENDING, 3)
        assert until(lambda: accepted_connections(port) == 0, 7)


def test_no_more_sessions_than_may_be_and_those_there_are_go_on(
    daemon: Daemon, running: Process
) -> None:
    endpoint = parse_address(daemon.address)
    with ExitStack() as stack, daemon.link() as link:
        assert promised("most-sessions") == MOST_SESSIONS
        for _ in range(MOST_SESSIONS - 1):
            stack.enter_context(open_session(endpoint, None))
        with pytest.raises(UnreachableError, match="as many workstations as it may"):
            open_session(endpoint, None, 0.5)
        assert link.status().robot_id == ROBOT_ID
        assert RemoteControl(link).stop() == "stopped"
    with daemon.link() as link:
        assert link.robot_id == ROBOT_ID
    assert running.is_running()
