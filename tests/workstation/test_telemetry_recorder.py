import time
from pathlib import Path

import pytest

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.measure.maneuvers.telemetry_recorder import TelemetryRecorder

from .fake_robot import FakeRobot
from .samples import decision


def test_what_the_robot_publishes_is_in_the_file(robot: FakeRobot, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with RobotLink(robot.address) as link, TelemetryRecorder(link, path) as recorder:
        until_s = time.monotonic() + 1.5
        while time.monotonic() < until_s:  # a subscription takes a moment to reach the robot
            robot.publish(decision(7))
            time.sleep(0.02)
    assert recorder.failure is None
    assert decision(7) in [beat.decision for beat in read_drive(path).beats]


def test_a_file_that_cannot_be_made_is_said_at_once(robot: FakeRobot, tmp_path: Path) -> None:
    path = tmp_path / "no such folder" / "drive.mcap"
    with (
        RobotLink(robot.address) as link,
        pytest.raises(ConfigurationError, match="no such folder"),
        TelemetryRecorder(link, path),
    ):
        pass
