"""`Robot`: which one it is, what it does, and that importing it costs little."""

import sys
from pathlib import Path

import pytest

from mbot import ConfigurationError, MbotError, RefusedError, Robot, UnreachableError
from mbot.robot import Robot as Same
from mbot_protocol.v1.messages_pb2 import Fault, State, Status
from mbot_protocol.wire.keys import COMMAND, STATUS
from mbot_workstation.fleet.enrolment.membership import Enrolment

from ..free_port import free_port
from ..ran import ran, without_robot
from ..workstation.fake_robot import FakeRobot
from ..workstation.samples import small_policy


@pytest.fixture(autouse=True)
def nobody_enrolled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("MBOT_ROBOT", raising=False)


def kinds(fake: FakeRobot) -> list[str | None]:
    return [command.WhichOneof("action") for command in fake.commands()]


def test_importing_it_loads_no_simulation_and_no_learning() -> None:
    code = (
        "import sys; import mbot; "
        "heavy = {'torch', 'gymnasium', 'mujoco', 'onnxruntime', 'matplotlib', 'typer'}; "
        "sys.exit(str(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)"
    )
    done = ran(sys.executable, "-c", code, env=without_robot())
    assert (done.returncode, done.stderr) == (0, "")
    assert Robot is Same


def test_looking_sets_nothing_in_motion(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        assert robot.name == "mbot-1"
        assert (robot.state().state, robot.state().model) == ("idle", "old")
        robot.let_go()
    assert kinds(fake) == []


def test_a_policy_that_runs_goes_on_after_the_block(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        robot.run()
    assert kinds(fake) == ["run"]


def test_run_lets_go_and_drive_takes_over(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        robot.drive(0.2, 0.2)
        robot.run()
        told = fake.commands()
        assert told[-2].drive.let_go
        assert not told[-1].run.when_ready
        robot.run(when_ready=True)
        assert fake.commands()[-1].run.when_ready
        robot.drive(0.2, 0.2)
    assert fake.commands()[-1].drive.let_go


def test_a_robot_that_waits_says_for_what(fake: FakeRobot) -> None:
    def waits(_: bytes) -> Status:
        told = fake.status()
        told.state = State.STATE_FAULT
        told.faults.append(Fault(kind="camera-lost", detail="no picture; check the cable"))
        return told

    fake.replies[STATUS.name] = waits
    with Robot(fake.address) as robot:
        state = robot.run(when_ready=True)
    assert (state.state, state.may_run) == ("fault", False)
    assert state.faults == ("camera-lost: no picture; check the cable",)


def test_a_stop_right_behind_a_run_is_told(fake: FakeRobot) -> None:
    answer = fake.replies[COMMAND.name]

    def stopped(data: bytes) -> object:
        reply = answer(data)
        fake.stops += 1
        return reply

    fake.replies[COMMAND.name] = stopped  # pyright: ignore[reportArgumentType]
    with Robot(fake.address) as robot, pytest.raises(RefusedError, match="look with"):
        robot.run()


def test_a_daemon_that_was_started_again_is_looked_at_first(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        status = fake.status

        def another(_: bytes) -> Status:
            told = status()
            told.session_id = 7
            return told

        fake.replies[STATUS.name] = another
        with pytest.raises(RefusedError, match="started again"):
            robot.drive(0.1, 0.1)
        robot.state()
        robot.drive(0.1, 0.1)


def test_a_policy_is_checked_pushed_and_active(fake: FakeRobot, tmp_path: Path) -> None:
    path = tmp_path / "new.onnx"
    path.write_bytes(small_policy().SerializeToString())
    with Robot(fake.address) as robot:
        assert robot.push(path).model == "new"
        with pytest.raises(MbotError, match="broken"):
            robot.push(tmp_path / "broken.onnx")
    assert kinds(fake) == []


def test_a_robot_that_trusts_nobody_here_is_said(fake: FakeRobot, tmp_path: Path) -> None:
    fake.trusted_keys = ["ed25519:AAAA anna"]
    path = tmp_path / "new.onnx"
    path.write_bytes(small_policy().SerializeToString())
    with Robot(fake.address) as robot, pytest.raises(RefusedError, match="workstation keys new"):
        robot.push(path)


def test_two_at_once_are_two(fake: FakeRobot) -> None:
    with FakeRobot("mbot-2") as other, Robot(fake.address) as one, Robot(other.address) as two:
        one.drive(0.1, 0.1)
        two.drive(0.2, 0.2)
        two.stop()
        assert (one.name, two.name) == ("mbot-1", "mbot-2")
        assert "stop" not in kinds(fake)
        assert kinds(other)[-1] == "stop"


def test_it_may_be_entered_again_and_not_be_used_outside(fake: FakeRobot) -> None:
    robot = Robot(fake.address)
    for _ in range(2):
        with robot:
            robot.drive(0.1, 0.1)
        with pytest.raises(RuntimeError, match="in a `with`"):
            robot.drive(0.1, 0.1)


# Which one


def test_the_environment_names_it(fake: FakeRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MBOT_ROBOT", fake.address)
    with Robot() as robot:
        assert robot.name == "mbot-1"


def test_the_only_enrolled_robot_is_meant_and_one_of_several_is_not() -> None:
    enrolment = Enrolment()
    port = free_port()
    enrolment.robot("mbot-1", ["127.0.0.1"], port=port)
    with pytest.raises(UnreachableError, match=f"no connection to tls/127.0.0.1:{port}"), Robot():
        pass
    enrolment.robot("mbot-2", ["127.0.0.1"])
    with pytest.raises(ConfigurationError, match=r"2 robots are enrolled here \(mbot-1, mbot-2\)"):
        Robot()
    with pytest.raises(UnreachableError, match=str(port)), Robot(robot_id="mbot-1"):
        pass
    with pytest.raises(ConfigurationError, match=r"no robot 'mbot-9' is enrolled"):
        Robot(robot_id="mbot-9")


def test_a_wrong_name_is_one_clear_error() -> None:
    with pytest.raises(UnreachableError, match="not known"), Robot("no-such-robot.invalid"):
        pass
    Enrolment().robot("mbot-1", ["10.0.0.7"])
    with pytest.raises(ConfigurationError, match="no robot 'mbot1' is enrolled here") as wrong:
        Robot("mbot1")
    assert len(str(wrong.value).splitlines()) == 1


def test_one_that_is_not_there_is_said_on_entering() -> None:
    with (
        pytest.raises(UnreachableError, match="is mbot-agent running"),
        Robot(f"127.0.0.1:{free_port()}"),
    ):
        pass
