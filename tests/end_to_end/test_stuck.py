"""The virtual robot driven at the border of its arena by the real daemon."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mbot_protocol.drive.mcore import STOP
from mbot_protocol.v1.messages_pb2 import State
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.camera.scene_renderer import TRAINING
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_parameters import Arena, SceneParameters
from mbot_workstation.virtual.camera_stream import NOISY, CameraSettings
from mbot_workstation.virtual.stand_in import VirtualRobot, VirtualRobotSettings

from ..promised import promised
from ..reliability.effort import within
from ..robot.tiny_models import constant_model
from .processes import Daemon, until

WALL_M = 0.6
FAR_M = 100.0
"""Where the task's border is: nobody carries the robot back to the middle."""


@contextmanager
def driven_at_the_wall(folder: Path, isp: IspSettings) -> Iterator[tuple[Daemon, VirtualRobot]]:
    daemon = Daemon(folder, str(folder / "board"))
    settings = VirtualRobotSettings(
        scene=SceneParameters(arena=Arena(border_m=FAR_M, wall_m=WALL_M)),
        room_picture=generate_room(0, 64),
        camera=CameraSettings(quality=TRAINING, isp=isp),
        camera_port=daemon.camera_port,
        board_link=folder / "board",
    )
    with VirtualRobot(settings) as robot, daemon.start():
        assert robot.wait_until_ready()
        assert daemon.is_up()
        daemon.push(constant_model(0.6, 0.6))
        daemon.run()
        yield daemon, robot


def test_a_robot_at_the_border_stops_and_says_that_it_is_stuck(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    with driven_at_the_wall(tmp_path, NOISY) as (daemon, robot):

        def stopped_s() -> float:
            """Of driving, until the wheels stand again; it leaves the robot at the wall."""
            stops = daemon.status().last_stop.count
            assert until(lambda: robot.world.status().motors != STOP)
            began_s = time.monotonic()
            assert until(lambda: robot.world.status().motors == STOP, 20)
            took_s = time.monotonic() - began_s
            assert until(lambda: daemon.status().state == State.STATE_STOPPED)
            status = daemon.status()
            assert [fault.kind for fault in status.faults] == ["stuck"]
            assert status.last_stop.count == stops + 1
            daemon.run()
            return took_s

        stopped_s()  # it has to get there first
        found = within(promised("stuck-stopped"), stopped_s)
    record_property("stuck, stopped after s", round(max(found), 2))


def test_without_noise_its_camera_is_believed_to_be_frozen_even_sooner(tmp_path: Path) -> None:
    """Nobody can tell one from the other by pictures that are the same to the last bit."""
    with driven_at_the_wall(tmp_path, IspSettings()) as (daemon, robot):
        assert until(lambda: robot.world.status().motors != STOP)
        assert until(lambda: daemon.status().state == State.STATE_FAULT, 20)
        assert robot.world.status().robot.x_m > WALL_M - 0.1
        assert [fault.kind for fault in daemon.status().faults] == ["camera-frozen"]
        assert until(lambda: daemon.status().state == State.STATE_STOPPED)
        assert robot.world.status().motors == STOP
