import socket
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from mbot_protocol.errors import (
    ConfigurationError,
    NewerSchemaError,
    RefusedError,
    UnreachableError,
)
from mbot_protocol.v1.messages_pb2 import Command, CommandReply, Status
from mbot_protocol.wire.keys import COMMAND, STATUS
from mbot_protocol.wire.schema import MalformedMessageError
from mbot_workstation.fleet.link import diagnosis as link_diagnosis
from mbot_workstation.fleet.link import robot_session
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.security import LinkSecurity, link_security

from ..free_port import free_port
from ..until import until
from .fake_robot import SESSION_ID, FakeRobot


def test_the_only_robot_is_found_and_asked(link: RobotLink) -> None:
    assert link.robot_id == "mbot-1"
    assert link.status().session_id == SESSION_ID


def test_no_close_of_a_connection_with_a_robot_that_is_gone_is_waited_for() -> None:
    """Also of one that Zenoh has reopened by itself."""
    port = free_port()
    with ExitStack() as stack:
        with FakeRobot("mbot-1", port) as robot:
            stack.enter_context(RobotLink(robot.address, "mbot-1"))
            assert until(lambda: lingering(port) == [False], 5)
        assert until(lambda: lingering(port) == [], 5)
        with FakeRobot("mbot-1", port):
            assert until(lambda: lingering(port) == [False], 10)


def lingering(port: int) -> list[bool]:
    """Of each of this process's connections with it: whether a close would wait."""
    found: list[bool] = []
    for fd in Path("/proc/self/fd").iterdir():
        with suppress(OSError), socket.socket(fileno=int(fd.name)) as one:
            try:
                if one.getpeername()[1] == port:
                    option = one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)
                    found.append(option[:4] != bytes(4))
            finally:
                one.detach()
    return found


def test_the_address_may_come_from_the_environment(
    robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MBOT_ROBOT", robot.address)
    with RobotLink() as link:
        assert link.robot_id == "mbot-1"


def test_two_robots_are_listed_and_one_can_be_chosen() -> None:
    with FakeRobot("mbot-1", None, "mbot-2") as robot:
        with (
            pytest.raises(UnreachableError, match=r"mbot-1, mbot-2; choose one, such as --id"),
            RobotLink(robot.address),
        ):
            pass
        with RobotLink(robot.address, "mbot-1") as link:
            assert link.status().robot_id == "mbot-1"


def test_a_robot_that_is_not_there_is_named_with_those_that_are(robot: FakeRobot) -> None:
    with (
        RobotLink(robot.address, "mbot-9") as link,
        pytest.raises(UnreachableError, match=r"mbot-9 at tcp/.*alive there: mbot-1"),
    ):
        link.status()


def test_an_identifier_with_a_wildcard_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="robot id"):
        RobotLink("127.0.0.1", "*")


def test_a_refused_connection_is_told_at_once_with_advice() -> None:
    began_s = time.monotonic()
    with (
        pytest.raises(UnreachableError, match="nothing listens there; is mbot-agent running"),
        RobotLink(f"127.0.0.1:{free_port()}"),
    ):
        pass
    assert time.monotonic() - began_s < 2


def test_a_refusal_elsewhere_advises_the_tunnel(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_args: object, **_named: object) -> None:
        raise ConnectionRefusedError

    monkeypatch.setattr(link_diagnosis.socket, "create_connection", refuse)
    with pytest.raises(UnreachableError, match="ssh -L 7447"), RobotLink("10.1.2.3"):
        pass


def test_an_unknown_name_is_told() -> None:
    with pytest.raises(UnreachableError, match="not known"), RobotLink("no-such-robot.invalid"):
        pass


def test_a_stranger_that_says_nothing_is_no_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_session.open_session, "__defaults__", (0.5,))
    with socket.create_server(("127.0.0.1", 0)) as stranger:
        port = stranger.getsockname()[1]
        with (
            pytest.raises(UnreachableError, match="is it an mbot-agent"),
            RobotLink(f"127.0.0.1:{port}"),
        ):
            pass


def test_a_closed_link_can_not_be_asked(robot: FakeRobot) -> None:
    with RobotLink(robot.address) as link:
        pass
    with pytest.raises(RuntimeError, match="not open"):
        link.status()


def test_a_newer_schema_is_told(robot: FakeRobot, link: RobotLink) -> None:
    robot.replies[STATUS.name] = lambda _data: Status(schema_version=2)
    with pytest.raises(NewerSchemaError, match="robot mbot-1 speaks schema 2"):
        link.status()


@pytest.mark.parametrize("reply", [b"\xff\xff\xff", b""])
def test_a_malformed_reply_is_told(robot: FakeRobot, link: RobotLink, reply: bytes) -> None:
    robot.replies[STATUS.name] = lambda _data: reply
    with pytest.raises(MalformedMessageError, match="robot mbot-1 sent"):
        link.status()


def test_an_error_reply_is_one_safe_line(robot: FakeRobot, link: RobotLink) -> None:
    robot.replies[STATUS.name] = lambda _data: "no\n\x1b[31mway" + "!" * 1000
    with pytest.raises(RefusedError, match=r"mbot-1 refused status: no \[31mway!") as caught:
        link.status()
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500


def test_a_robot_that_does_not_reply_is_named(robot: FakeRobot, link: RobotLink) -> None:
    robot.replies[COMMAND.name] = lambda _data: None
    with pytest.raises(UnreachableError, match=r"no reply to command within 0\.3 s although"):
        link.query(COMMAND, Command(schema_version=1), CommandReply, timeout_s=0.3)


def test_the_link_outlives_a_restart_of_the_robot() -> None:
    with FakeRobot() as first, RobotLink(first.address) as link:
        assert link.status().robot_id == "mbot-1"
        first.__exit__(None, None, None)
        with pytest.raises(UnreachableError, match="no robot is alive there"):
            link.status()
        with FakeRobot(port=first.port):
            for _ in range(100):
                try:
                    assert link.status().robot_id == "mbot-1"
                    return
                except UnreachableError:
                    time.sleep(0.1)
        pytest.fail("the link did not come back within 10 s")


def test_certificates_are_checked_before_anything_is_opened(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no such file"):
        LinkSecurity(tmp_path / "none.pem")
    ca = tmp_path / "ca.pem"
    ca.write_text("nothing")
    with pytest.raises(ConfigurationError, match="belong together"):
        LinkSecurity(ca, certificate=ca)
    with pytest.raises(ConfigurationError, match="need --ca"):
        link_security(None, ca, ca)
    with pytest.raises(ConfigurationError, match="needs --ca"), RobotLink("tls/127.0.0.1"):
        pass
    with (
        pytest.raises(ConfigurationError, match="not tls/"),
        RobotLink("tcp/127.0.0.1", None, LinkSecurity(ca)),
    ):
        pass
