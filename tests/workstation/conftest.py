from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_workstation.fleet.link.robot_link import RobotLink

from .fake_robot import FakeRobot


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    with FakeRobot() as fake:
        yield fake


@pytest.fixture
def link(robot: FakeRobot) -> Iterator[RobotLink]:
    with RobotLink(robot.address) as link:
        yield link


@pytest.fixture
def drive() -> RecordedDrive:
    """A robot's own recording of 12 decisions."""
    return read_drive(Path(__file__).parents[1] / "data" / "recorded-drive")
