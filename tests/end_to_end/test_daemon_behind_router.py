"""The real daemon behind the router that `workstation enroll --router` makes: each command of the
README, STOP first. A stand-in that declares its keys otherwise than the daemon shows nothing.
"""

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from mbot_agent.configuration import Access
from mbot_protocol.errors import UnreachableError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_protocol.wire.access_rules import robot_access
from mbot_protocol.wire.keys import STATUS, STOP, TOPICS, Flow, Right
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.enrolment.bundles import MOST_STOPS_HZ
from mbot_workstation.fleet.link.remote_control import STOP_TIMEOUT_S, RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.push import push

from ..free_port import free_port
from ..ran import ran
from ..reliability.effort import second_worst
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .fleet import LOCALHOST, Fleet
from .processes import HERE, PROGRAMS, ROBOT_ID, Daemon, Process, until
from .stop_flood import SESSIONS

FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)
DORA = "dora"
FLOOD_S = 8


@pytest.fixture
def fleet(tmp_path: Path) -> Fleet:
    fleet = Fleet(tmp_path / "mbot-agent" / "fleet")
    fleet.enrolment.router("lab", [LOCALHOST], free_port())
    fleet.enrol(ROBOT_ID, {DORA: [Right.PUSH, Right.DRIVE], "vera": [Right.VIEW]}, router="lab")
    return fleet


@pytest.fixture
def behind(tmp_path: Path, board: FakeBoard, fleet: Fleet) -> Iterator[Daemon]:
    """Up, with a camera, connected to the router."""
    daemon = Daemon(tmp_path, board.path)
    daemon.address = f"{LOCALHOST}:{fleet.ports[ROBOT_ID]}"
    (tmp_path / "enrolment.toml").write_text(fleet.enrolment_text(ROBOT_ID))
    settings = zenoh.Config.from_json5(fleet.router_settings("lab"))
    with zenoh.open(settings), daemon.camera(), daemon.start():
        assert daemon.is_up()
        yield daemon


def is_there(fleet: Fleet) -> bool:
    try:
        with fleet.link(ROBOT_ID, DORA) as link:
            return not [fault for fault in link.status().faults if fault.kind != "no-model"]
    except UnreachableError:
        return False


@pytest.mark.timeout(180)
def test_every_command_of_the_readme_comes_through_and_stop_first(
    behind: Daemon, fleet: Fleet, board: FakeBoard, tmp_path: Path
) -> None:
    def workstation(*arguments: str, fails: int = 0) -> str:
        command = [PROGRAMS.format("workstation"), *arguments]
        environment = {
            "PATH": "/usr/bin:/bin",
            "HOME": str(tmp_path),
            "XDG_CONFIG_HOME": str(tmp_path),
        }
        done = ran(*command, env=environment)
        assert done.returncode == fails, (arguments, done.stdout, done.stderr)
        return done.stdout + done.stderr

    assert until(lambda: is_there(fleet), 20)
    to_robot = ("--robot", ROBOT_ID)
    assert "stopped" in workstation("stop", *to_robot)
    model = tmp_path / "forward.onnx"
    model.write_bytes(FORWARD)
    assert ROBOT_ID in workstation("robots", *to_robot)
    with fleet.link(ROBOT_ID, DORA) as link:
        push(link, model, lambda _: behind.key)
    assert "constant" in workstation("models", *to_robot)
    assert "running" in workstation("run", *to_robot)
    assert board.wait_for(*FORWARD_BOARD)
    began_s = time.monotonic()
    assert "stopped" in workstation("stop", *to_robot)
    assert board.speeds == (0, 0)
    stopped_s = time.monotonic() - began_s
    assert stopped_s < 5
    workstation("drive", "0.5", "0.5", "--for", "0.5", *to_robot)
    workstation("telemetry", *to_robot, "--json", "--seconds", "1")
    workstation("recordings", "list", *to_robot)
    workstation("rollback", *to_robot, fails=6)


@pytest.mark.timeout(120)
@pytest.mark.usefixtures("behind")
def test_a_flood_of_stops_through_the_router_holds_up_nobody_elses(
    fleet: Fleet, tmp_path: Path
) -> None:
    """The robot sees one link for all; the router passes on 50 a second of each of its own."""
    assert until(lambda: is_there(fleet), 20)
    vera = fleet.security("vera")
    router = fleet.folder.roll().routers["lab"]
    program = [str(HERE / "stop_flood.py"), f"{LOCALHOST}:{router.port}", ROBOT_ID, str(FLOOD_S)]
    program += [str(path) for path in (vera.ca, vera.certificate, vera.key)]
    found_ms: list[float] = []
    with fleet.link(ROBOT_ID, DORA) as link:
        control = RemoteControl(link)
        before = link.status().last_stop.count
        with Process(sys.executable, *program, "20000", log=tmp_path / "flood.log") as flood:
            while flood.is_running():
                began_s = time.monotonic()
                assert control.stop() == "stopped"
                found_ms.append((time.monotonic() - began_s) * 1000)
                time.sleep(0.3)
            assert flood.wait() == 0
        came = link.status().last_stop.count - before
    assert len(found_ms) > 10
    assert second_worst(found_ms) <= 100
    assert max(found_ms) < STOP_TIMEOUT_S * 1000
    assert came <= MOST_STOPS_HZ * SESSIONS * FLOOD_S * 1.5 + len(found_ms)


@pytest.mark.usefixtures("behind")
def test_every_key_of_the_table_is_answered_by_the_daemon(fleet: Fleet) -> None:
    """Any answer: an empty request is refused by most. Silence means that the router knows none."""
    assert until(lambda: is_there(fleet), 20)
    with fleet.link(ROBOT_ID, DORA) as link:
        session = link._session  # pyright: ignore[reportPrivateUsage]
        assert session is not None
        silent = [
            topic.name
            for topic in TOPICS
            if topic.flow is Flow.QUERY
            and not [
                reply
                for reply in session.get(topic.key(ROBOT_ID), payload=b"", timeout=3.0)
                if reply.ok is not None
            ]
        ]
    assert silent == []


def test_nothing_sets_a_robot_in_motion_whose_stop_does_not_get_through() -> None:
    """An older daemon declares `stop/**`, which the rules let no router know of."""
    router, port = f"tcp/{LOCALHOST}:{free_port()}", free_port()

    def opened(mode: str, **settings: object) -> zenoh.Session:
        config = zenoh.Config()
        common = {"mode": mode, "scouting/multicast/enabled": False}
        for key, value in (common | settings).items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)

    status = Status(schema_version=SCHEMA_VERSION, robot_id=ROBOT_ID).SerializeToString()
    access = robot_access(ROBOT_ID, Access().people, (), loopback=True)
    with (
        opened("router", **{"listen/endpoints": [router]}),
        opened(
            "peer",
            **{
                "listen/endpoints": [f"tcp/{LOCALHOST}:{port}"],
                "connect/endpoints": [router],
                "access_control": access,
            },
        ) as old,
        old.declare_queryable(f"{STOP.key(ROBOT_ID)}/**", zenoh.handlers.RingChannel(4)),
        old.declare_queryable(STATUS.key(ROBOT_ID), lambda q: q.reply(q.key_expr, status)),
    ):
        with RobotLink(router.removeprefix("tcp/"), ROBOT_ID) as link:
            assert until(lambda: link.reaches(STATUS), 10)
            for word in (
                lambda: RemoteControl(link).run(),
                lambda: RemoteControl(link).drive(0.4, 0.4, 300),
                lambda: RemoteControl(link).catch_up(1),
            ):
                with pytest.raises(UnreachableError, match="STOP does not get through"):
                    word()
        # Straight to the robot it is heard, whatever it has declared.
        with RobotLink(f"{LOCALHOST}:{port}", ROBOT_ID) as link:
            assert link.reaches(STOP)
