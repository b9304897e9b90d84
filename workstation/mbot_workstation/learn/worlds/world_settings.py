"""What the worlds of an environment are made of."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.sim.effects.scene_looks import training_floors
from mbot_workstation.sim.scene.floor_textures import FloorTexture
from mbot_workstation.sim.scene.room import fit_room
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task
from mbot_workstation.tasks.lesson import Lesson, lesson_named

GENERATED_ROOMS = 8
GENERATED_WIDTH_PX = 512
"""1.4 pixels a degree, against an observation's 1.2."""

LARGEST_ROOM_WIDTH_PX = 1024
"""More would only be averaged away, in memory that every worker needs."""


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """Everything a process needs to build worlds; it can be pickled.

    Attributes:
        ranges: what robots there are.
        lesson: to start with.
        rooms: panoramas, shape (h, 2 h, 3) each, RGB; one is drawn for every episode.
        robot: what the effects start from.
        scene: what is around it.
        floors: besides the nominal one, where arenas vary.
        task: what robots are to do, by its reference: `find_task`.

    """

    ranges: EffectRanges
    lesson: Lesson
    rooms: tuple[Picture, ...]
    robot: RobotParameters = field(default_factory=RobotParameters)
    scene: SceneParameters = field(default_factory=SceneParameters)
    floors: tuple[FloorTexture, ...] = ()
    task: str = DEFAULT_TASK


def world_settings(
    ranges: str | EffectRanges,
    start: str | Lesson,
    rooms: Sequence[Picture] | None,
    robot: RobotParameters | None = None,
    scene: SceneParameters | None = None,
    task: str = DEFAULT_TASK,
) -> WorldSettings:
    """Settings from what a user names.

    Args:
        ranges: of effects, or a preset's name.
        start: lesson, or its name.
        rooms: panoramas; None or none generates some.
        robot: the nominal one when None.
        scene: likewise.
        task: by its reference.

    Raises:
        ConfigurationError: there is no such task.
        ValueError: there is no such preset or lesson.

    """
    if isinstance(ranges, str):
        ranges = preset(ranges)
    if isinstance(start, str):
        start = lesson_named(find_task(task).lessons, start)
    if not rooms:
        rooms = [generate_room(seed, GENERATED_WIDTH_PX) for seed in range(GENERATED_ROOMS)]
    return WorldSettings(
        ranges=ranges,
        lesson=start,
        rooms=tuple(fit_room(room, min(room.shape[1], LARGEST_ROOM_WIDTH_PX)) for room in rooms),
        robot=robot or RobotParameters(),
        scene=find_task(task).scene(scene or SceneParameters()),
        floors=tuple(training_floors()) if ranges.high.scene_variety > 0 else (),
        task=task,
    )
