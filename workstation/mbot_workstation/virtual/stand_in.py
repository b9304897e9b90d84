"""The virtual robot: what looks like a robot's hardware from outside, put together.

Threads: the world (physics and task), the camera (drawing), the board (the pty), the server (one
more for every client). The first three only share what `SceneHistory`, `McoreBoard.state` and
`LiveWorld.status` hand over.
"""

import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Self

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.scene_looks import training_floors
from mbot_workstation.sim.scene.scene_look import SceneDresser, SceneLook, nominal_look
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.simulation import SceneState, Simulation
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task
from mbot_workstation.tasks.lesson import Lesson
from mbot_workstation.virtual.camera_stream import CameraSettings, CameraStream
from mbot_workstation.virtual.emulated.emulated_board import EmulatedBoard
from mbot_workstation.virtual.live_world import LiveWorld, setting_of
from mbot_workstation.virtual.mcore_board import McoreBoard
from mbot_workstation.virtual.mjpeg_server import MjpegServer
from mbot_workstation.virtual.surroundings import Surroundings


@dataclass(frozen=True, slots=True)
class VirtualRobotSettings:
    """How a virtual robot is made.

    Attributes:
        robot, scene: what is simulated.
        look: of the arena, its made-up floors and things besides; None is the nominal one.
        room_picture: panorama, shape (h, 2 h, 3), RGB; None generates one.
        task: what it is to do, by its name or file.
        lesson: of it, as it is played; None is the usual one.
        camera: of the camera.
        camera_port: TCP port of the stream on loopback; 0 is any free one.
        board_link: where to put a symbolic link to the board's port.
        boot_s: how long the board is deaf after its port was opened; 0 is never.
        firmware: ELF or Intel HEX file that an emulated board runs; None: the modelled board.
        latency_s: from a command's arrival at the board until the wheels' voltage changes.
        seed: of the objects' places.
        free_floor: no task, nothing in the way; a robot that stands is carried back to the middle.
        table_m: width and depth of a table that it stands on the middle of, as its sensors feel;
            pictures show a floor. None: no table.

    """

    robot: RobotParameters = field(default_factory=RobotParameters)
    scene: SceneParameters = field(default_factory=SceneParameters)
    look: SceneLook | None = None
    room_picture: Picture | None = None
    task: str = DEFAULT_TASK
    lesson: Lesson | None = None
    camera: CameraSettings = field(default_factory=CameraSettings)
    camera_port: int = 0
    board_link: Path | None = None
    boot_s: float = 0.0
    firmware: Path | None = None
    latency_s: float = 0.0
    seed: int = 0
    free_floor: bool = False
    table_m: tuple[float, float] | None = None


class VirtualRobot:
    """A running virtual robot; use it in a `with`.

    Attributes:
        simulation: read-only for others while it runs; use `world.status()`.
        board, world, camera, server: its parts.
        surroundings: what its sensors feel.
        stopped: set when it has ended by itself or failed.

    """

    def __init__(self, settings: VirtualRobotSettings) -> None:
        task = find_task(settings.task)
        scene = task.scene(settings.scene)
        floors = () if settings.look is None else training_floors()
        self.simulation = Simulation(settings.robot, scene, settings.room_picture, floors)
        look = settings.look or nominal_look(scene)
        self.server = MjpegServer(settings.camera_port)
        board = self.board = _board(settings)
        self.surroundings = Surroundings(
            scene.arena.wall_m,
            tuple(thing.footprint.reach_m for thing in scene.objects),
            settings.table_m,
            track_m=settings.robot.track_m,
        )
        self.world = LiveWorld(
            self.simulation,
            self.board,
            task,
            settings.lesson or task.play(None, None, ends_on_failure=True),
            setting_of(self.simulation, look),
            settings.seed,
            settings.latency_s,
            free_floor=settings.free_floor,
            feel=partial(self.surroundings.tell, board)
            if isinstance(board, EmulatedBoard)
            else lambda *_: None,
        )
        dresser = SceneDresser(self.simulation.model, 1 + len(floors), scene.objects)
        dresser.wear(look.furnished(self.world.pieces()))
        self._ready = threading.Event()
        self.camera = CameraStream(
            self.simulation, self.world.history, settings.camera, self._publish
        )
        self.stopped = threading.Event()
        self._failure: BaseException | None = None
        self._resources = ExitStack()
        self._threads: list[threading.Thread] = []

    def wait_until_ready(self, timeout_s: float = 30.0) -> bool:
        """Wait for the first picture; False when it does not come in time."""
        waited_s = 0.0
        while not self._ready.wait(0.05) and waited_s < timeout_s:
            if self.stopped.is_set():
                break
            waited_s += 0.05
        self.raise_failure()
        return self._ready.is_set()

    def raise_failure(self) -> None:
        """Raise what has ended one of the threads, if anything has."""
        if self._failure is not None:
            raise self._failure

    def run_beside(self, name: str, loop: Callable[[threading.Event], None]) -> None:
        """Run a loop in a thread until `stopped`; what it raises stops the robot."""
        thread = threading.Thread(target=self._guard, args=(loop,), name=name, daemon=True)
        self._threads.append(thread)
        thread.start()

    def scene_state(self) -> SceneState:
        """What there is to see now."""
        return self.world.history.newest()

    def __enter__(self) -> Self:
        with ExitStack() as resources:
            resources.enter_context(self.server)
            resources.enter_context(self.board)
            self._resources = resources.pop_all()
        self.run_beside("world", self._run_world)
        self.run_beside("camera", self.camera.run)
        return self

    def __exit__(self, *_: object) -> None:
        self.stopped.set()
        for thread in self._threads:
            thread.join()
        self._resources.close()

    def _publish(self, jpeg: bytes) -> None:
        self.server.publish(jpeg)
        self._ready.set()

    def _run_world(self, stop: threading.Event) -> None:
        self.world.run(stop)
        stop.set()  # the run is over, so the camera may go as well

    def _guard(self, loop: Callable[[threading.Event], None]) -> None:
        try:
            loop(self.stopped)
        except BaseException as error:
            self._failure = error
            self.stopped.set()


def _board(settings: VirtualRobotSettings) -> McoreBoard | EmulatedBoard:
    link, boot_s = settings.board_link, settings.boot_s
    if settings.firmware is None:
        return McoreBoard(link, boot_s=boot_s)
    return EmulatedBoard(settings.firmware, link, boot_s=boot_s)
