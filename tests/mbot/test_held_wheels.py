"""A hand of Python's on the wheels: what keeps it there, and everything that ends it."""

import time

import pytest

from mbot import ConfigurationError, RefusedError, Robot, UnreachableError
from mbot.held_wheels import HeldWheels
from mbot_protocol.v1.messages_pb2 import Command, CommandReply, Drive
from mbot_protocol.wire.keys import COMMAND
from mbot_workstation.fleet.by_hand.timed_drive import HOLD_MS
from mbot_workstation.fleet.link.robot_link import RobotLink

from ..until import until
from ..workstation.fake_robot import FakeRobot


def drives(fake: FakeRobot) -> list[Drive]:
    return [one.drive for one in fake.commands() if one.HasField("drive")]


def wheels(drive: Drive) -> tuple[float, float]:
    return round(drive.wheels.left, 3), round(drive.wheels.right, 3)


def test_one_word_is_repeated_until_the_hand_lets_go(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        robot.drive(0.4, -0.2)
        assert until(lambda: len(drives(fake)) > 5)
        robot.let_go()
        told = drives(fake)
        assert {(wheels(one), one.hold_ms, one.press) for one in told[:-1]} == {
            ((0.4, -0.2), HOLD_MS, 1)
        }
        assert (wheels(told[-1]), told[-1].let_go) == ((0, 0), True)
        time.sleep(0.3)
        assert len(drives(fake)) == len(told)


def test_other_wheels_are_the_same_hold_and_a_later_one_is_another(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        robot.drive(0.4, 0.4)
        robot.drive(-0.1, 0.1)
        assert until(lambda: wheels(drives(fake)[-1]) == (-0.1, 0.1))
        robot.let_go()
        robot.let_go()
        robot.drive(0.2, 0.2)
    told = drives(fake)
    assert sum(one.let_go for one in told) == 2
    assert sorted({one.press for one in told}) == [1, 2]
    assert told[-1].let_go


def test_an_exception_and_ctrl_c_let_go(fake: FakeRobot) -> None:
    def fail(error: type[BaseException]) -> None:
        with Robot(fake.address) as robot:
            robot.drive(0.4, 0.4)
            raise error

    for error in (ZeroDivisionError, KeyboardInterrupt):
        with pytest.raises(error):
            fail(error)
        told = drives(fake)
        assert told[-1].let_go
        time.sleep(0.3)
        assert len(drives(fake)) == len(told)


def test_so_many_seconds_are_waited_for(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        began_s = time.monotonic()
        robot.drive(0.4, 0.4, seconds=0.5)
        assert 0.5 <= time.monotonic() - began_s < 2.0
        assert drives(fake)[-1].let_go


def test_somebodys_stop_is_not_driven_over_before_the_program_has_looked(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        robot.drive(0.4, 0.4)
        fake.stops += 1  # and the robot refuses from now on
        told = len(drives(fake))
        assert until(lambda: len(drives(fake)) > told)
        for _ in range(2):  # being told of it is no look
            with pytest.raises(RefusedError, match=r"look with robot\.state\(\)") as refused:
                robot.drive(0.4, 0.4)
            assert refused.value.kind == "stopped-meanwhile"
        with pytest.raises(RefusedError, match="look with"):
            robot.run()
        told = len(drives(fake))
        time.sleep(0.3)
        assert len(drives(fake)) == told
        robot.state()
        robot.drive(0.3, 0.3)
        assert fake.commands()[-1].stop_count == fake.stops


def test_a_stop_while_it_waits_is_told(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        answer = fake.replies[COMMAND.name]

        def stopped_soon(data: bytes) -> object:
            fake.stops += len(drives(fake)) == 3
            return answer(data)

        fake.replies[COMMAND.name] = stopped_soon  # pyright: ignore[reportArgumentType]
        with pytest.raises(RefusedError, match="stopped by max"):
            robot.drive(0.4, 0.4, seconds=20.0)


def test_ones_own_stop_is_known(fake: FakeRobot) -> None:
    with Robot(fake.address) as robot:
        robot.drive(0.4, 0.4)
        robot.stop()
        told = len(drives(fake))
        time.sleep(0.3)
        assert len(drives(fake)) == told
        robot.drive(0.2, 0.2)
        assert wheels(drives(fake)[-1]) == (0.2, 0.2)


def test_a_hold_that_was_over_for_want_of_time_is_taken_again_by_the_next_word(
    fake: FakeRobot,
) -> None:
    answer = fake.replies[COMMAND.name]

    def over(data: bytes) -> object:
        if Command.FromString(data).drive.press == 1 and len(drives(fake)) > 1:
            return CommandReply(schema_version=1, reason="this hand has let go")
        return answer(data)

    fake.replies[COMMAND.name] = over  # pyright: ignore[reportArgumentType]
    with Robot(fake.address) as robot:
        robot.drive(0.4, 0.4)
        assert until(lambda: len(drives(fake)) > 1)
        robot.drive(0.4, 0.4)
        assert drives(fake)[-1].press == 2


def test_without_a_reply_it_says_so_and_holds_nothing(fake: FakeRobot) -> None:
    fake.replies[COMMAND.name] = lambda _: None
    with RobotLink(fake.address) as link:
        held = HeldWheels(link)
        with pytest.raises(UnreachableError, match="no reply to command"):
            held.hold(0.4, 0.4, link.status())
        told = len(drives(fake))
        held.close()
    assert len(drives(fake)) == told


@pytest.mark.parametrize(
    ("left", "right"),
    [(1.01, 0), (0, float("nan")), (float("inf"), 0), (True, 0), ("1", 0), (0, None)],
)
def test_a_wheel_that_is_no_wheel_is_named(fake: FakeRobot, left: float, right: float) -> None:
    with Robot(fake.address) as robot:
        with pytest.raises(ConfigurationError, match=r"(left|right) is .*, expected a number"):
            robot.drive(left, right)
        for seconds in (0, -1, float("nan")):
            with pytest.raises(ConfigurationError, match="seconds is"):
                robot.drive(0.1, 0.1, seconds=seconds)
    assert not drives(fake)
