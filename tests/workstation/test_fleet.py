"""What is told of a robot as a flat object."""

from mbot_protocol.v1.messages_pb2 import MotorMap, Status
from mbot_workstation.fleet.link.fleet import Motor, RobotReport


def test_motors_are_told_as_the_robot_drives_them() -> None:
    status = Status(left_motor=MotorMap(reversed=True, trim=0.9, dead_band=30))
    report = RobotReport.of("127.0.0.1:7447", "mbot-1", status)
    assert report.left_motor == Motor(reversed=True, trim=0.9, dead_band=30)
    assert report.right_motor is None  # an older robot says nothing of them
