"""Real daemon, real firmware, MuJoCo: what the robot does when the daemon is killed."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from signal import SIGKILL

from mbot_protocol.drive.mcore import STOP
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.scene_renderer import TRAINING
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.virtual.camera_stream import CameraSettings
from mbot_workstation.virtual.emulated.emulated_board import EmulatedBoard
from mbot_workstation.virtual.stand_in import VirtualRobot, VirtualRobotSettings

from ..end_to_end.processes import Daemon, Process
from ..promised import promised
from ..robot.tiny_models import constant_model
from ..until import until

TIMEOUT_US = 300_000
FORWARD = constant_model(1.0, 1.0)
ROBOT = RobotParameters()
FULL_SPEED_MPS = ROBOT.free_speed_rad_s * ROBOT.wheel_radius_m


@contextmanager
def driving(
    folder: Path,
    firmware: Path,
    senses: str = "",
    table_m: tuple[float, float] | None = None,
) -> Iterator[tuple[VirtualRobot, EmulatedBoard, Process]]:
    """A robot on its way, its board and the daemon that drives it."""
    daemon = Daemon(folder, str(folder / "board"))
    daemon.config.write_text(daemon.config.read_text() + senses)
    settings = VirtualRobotSettings(
        room_picture=generate_room(0, 64),
        camera=CameraSettings(width_px=160, height_px=120, quality=TRAINING),
        camera_port=daemon.camera_port,
        board_link=folder / "board",
        firmware=firmware,
        table_m=table_m,
    )
    with VirtualRobot(settings) as robot, daemon.start() as process:
        assert isinstance(robot.board, EmulatedBoard)
        assert robot.wait_until_ready()
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        assert until(lambda: speed_mps(robot) > 0.8 * FULL_SPEED_MPS)
        yield robot, robot.board, process


def speed_mps(robot: VirtualRobot) -> float:
    """Along the floor, if no wheel slips."""
    wheel_rad_s = sum(robot.world.status().wheel_speeds_rad_s) / 2
    return abs(wheel_rad_s) * ROBOT.wheel_radius_m


def distance_m(one: Pose, other: Pose) -> float:
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)


def test_the_robot_stops_soon_after_its_daemon_was_killed(
    tmp_path: Path, firmware_folder: Path, record_property: Callable[[str, object], None]
) -> None:
    with driving(tmp_path, firmware_folder / "mbot-deadman.hex") as (robot, board, process):
        before, killed_s = robot.world.status().robot, time.monotonic()
        process.signal(SIGKILL)
        assert until(lambda: board.state.motors == STOP)
        record_property("motors off ms", (board.changed_us - board.heard_us) / 1000)
        silence_us = board.changed_us - board.heard_us
        assert TIMEOUT_US - 1000 <= silence_us <= promised("deadman-stopped") * 1000
        assert until(lambda: speed_mps(robot) < 0.001)
        stood = robot.world.status()
        # In real time, however late this machine has let the emulator come.
        powered_s = board.state.since_s - killed_s
        longest_m = FULL_SPEED_MPS * (powered_s + 3 * ROBOT.left_motor.time_constant_s)
        assert 0 < distance_m(before, stood.robot) <= longest_m
        assert until(lambda: robot.world.status().time_s > stood.time_s + 0.5)
        assert distance_m(stood.robot, robot.world.status().robot) < 0.001


def test_without_a_dead_mans_switch_it_drives_on(tmp_path: Path, drives_on: Path) -> None:
    with driving(tmp_path, drives_on) as (robot, board, process):
        process.signal(SIGKILL)
        process.wait()
        before = robot.world.status().robot
        assert until(lambda: distance_m(before, robot.world.status().robot) > 0.3)
        assert board.state.motors != STOP


def test_it_stops_at_the_edge_of_a_table_and_says_why(
    tmp_path: Path, firmware_folder: Path
) -> None:
    firmware = firmware_folder / "mbot-deadman.hex"
    senses = '\n[senses]\nedge = "stop"\n'
    with driving(tmp_path, firmware, senses, (2.4, 1.6)) as (robot, board, _):
        assert until(lambda: board.state.motors == STOP)
        assert until(lambda: speed_mps(robot) < 0.001)
        log = tmp_path / "daemon.log"
        assert until(lambda: "there was no floor in front of it" in log.read_text())
        assert not robot.surroundings.has_fallen
        stood = robot.world.status()
        assert 1.0 < stood.robot.x_m < 1.2
        assert until(lambda: robot.world.status().time_s > stood.time_s + 1.0)
        assert distance_m(stood.robot, robot.world.status().robot) < 0.001


def test_without_being_told_it_drives_off_the_table(tmp_path: Path, firmware_folder: Path) -> None:
    firmware = firmware_folder / "mbot-deadman.hex"
    with driving(tmp_path, firmware, "", (2.4, 1.6)) as (robot, _, _):
        assert until(lambda: robot.surroundings.has_fallen)
