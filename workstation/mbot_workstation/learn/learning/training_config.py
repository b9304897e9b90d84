"""What a training run was told: everything needed to make it again."""

from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.learning.curriculum import PAPER_MARK, PassMark
from mbot_workstation.learn.learning.learner import LearnerSettings
from mbot_workstation.learn.learning.progress_log import ROW_EVERY
from mbot_workstation.learn.worlds.rooms import TRAINING_PHOTOGRAPHS
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.effects.presets import KNOWN, preset
from mbot_workstation.sim.scene.object_file import read_objects
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task, full_reference, is_file
from mbot_workstation.tasks.lesson import Lesson, lesson_named

REAL_SHARE = 0.25
"""Not measured on a robot: there was none."""


@dataclass(frozen=True, slots=True)
class TrainingConfig:
    """One run's configuration.

    Attributes:
        steps: decisions of all robots together.
        robots: how many learn in parallel; the paper's 16.
        workers: processes that simulate them; None is one a core.
        seed: of weights, exploration, rooms and robots.
        preset: effects of the real world, by name.
        calibration: the robot to train for, as its files said when the run began; None is the
            nominal one.
        object_file: what there is to find; empty is the red cube.
        lessons: names, in their order; the task's whole course if none are given.
        task: what to learn, by its name or file.
        pass_mark: on with the next one when this is reached.
        panoramas: files of the rooms to train in.
        shipped_photographs: whether the project's own are among them.
        made_up_rooms: how many generated rooms are added.
        target_reward: stop early when a progress row of the last lesson reaches it.
        parent: checkpoint whose weights the run starts from; empty is from nothing.
        hue_turn_deg: how far the object's hue is from that of the parent's object, which the
            parent's weights are turned by.
        drives: recordings of robots, from whose hands it learns besides.
        real_share: of the sequences that are rehearsed.
        device: torch's name of where the network learns.
        learner: PPO's numbers.
        checkpoint_every: decisions that a crash may cost.
        row_every: decisions a row of progress.csv.

    Raises:
        ConfigurationError: a number is too small, or there is no such preset, task, lesson or
            object.

    """

    steps: int = 1_500_000
    robots: int = 16
    workers: int | None = None
    seed: int = 0
    preset: str = "randomised"
    calibration: CalibrationFiles | None = None
    object_file: str = ""
    lessons: tuple[str, ...] = ()
    task: str = DEFAULT_TASK
    pass_mark: PassMark = PAPER_MARK
    panoramas: tuple[str, ...] = ()
    shipped_photographs: bool = False
    made_up_rooms: int = 6
    target_reward: float | None = None
    parent: str = ""
    hue_turn_deg: float = 0.0
    drives: tuple[str, ...] = ()
    real_share: float = REAL_SHARE
    device: str = "cpu"
    learner: LearnerSettings = field(default_factory=LearnerSettings)
    checkpoint_every: int = ROW_EVERY
    row_every: int = ROW_EVERY

    def __post_init__(self) -> None:
        for name, value, least in (
            ("steps", self.steps, 1),
            ("robots", self.robots, 1),
            ("rooms", len(self.photographs) + self.made_up_rooms, 1),
        ):
            if value < least:
                raise ConfigurationError(f"{name}: {value} given, expected at least {least}")
        try:
            self.ranges()
            self.stages()
            _ = self.scene
        except ValueError as error:
            raise ConfigurationError(str(error)) from None

    @property
    def photographs(self) -> tuple[Path, ...]:
        """Files of all rooms to train in that are photographs."""
        own = tuple(Path(name) for name in self.panoramas)
        return (*TRAINING_PHOTOGRAPHS, *own) if self.shipped_photographs else own

    def ranges(self) -> EffectRanges:
        """The effects of the robots to train on."""
        if self.calibration is None:
            return preset(self.preset)
        return self.calibration.ranges(self.preset)

    @property
    def robot(self) -> RobotParameters:
        """What the effects start from."""
        return self.calibration.robot if self.calibration else RobotParameters()

    @property
    def scene(self) -> SceneParameters:
        """What is around the robots."""
        scene = self.calibration.scene if self.calibration else SceneParameters()
        return replace(scene, objects=read_objects(self.object_file or None))

    def stages(self) -> tuple[Lesson, ...]:
        """The lessons themselves, their robots around the calibrated one."""
        task = find_task(self.task)
        names = self.lessons or task.course(guided=False, further=False)
        stages = tuple(lesson_named(task.lessons, name) for name in names)
        if self.calibration is None:
            return stages
        effects = self.calibration.effects
        return tuple(stage.moved(KNOWN, effects) for stage in stages)

    def resolved(self) -> dict[str, Any]:
        """Everything spelt out, for the run's folder: also what the names stand for."""
        effects = self.ranges()
        libraries = ("torch", "stable-baselines3", "gymnasium", "mujoco-core", "numpy")
        return {
            "training": msgspec.to_builtins(self),
            "lessons": [asdict(stage) for stage in self.stages()],
            "effects": {"low": asdict(effects.low), "high": asdict(effects.high)},
            "libraries": {name: version(name) for name in libraries},
        }


def read_config(path: Path, task: str = DEFAULT_TASK) -> TrainingConfig:
    """The configuration in a run's folder.

    Args:
        path: of the file.
        task: a file that stands in for the task's, which is never run because a folder says so: it
            may be a stranger's. Of no account where the run learned a task that ships.

    Raises:
        ConfigurationError: it can't be read, a field is unusable, or it wants a file to be run.

    """
    try:
        content = msgspec.json.decode(path.read_bytes())
        if is_file(stored := content["training"].get("task", DEFAULT_TASK)):
            if not is_file(task):
                raise ConfigurationError(
                    f"{path} learned the task in {stored}, which would have to be run: name it, or "
                    "where it is now, by --task FILE.py"
                )
            content["training"]["task"] = full_reference(task)
        return msgspec.convert(content["training"], TrainingConfig)
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    except (msgspec.DecodeError, AttributeError, KeyError, TypeError) as error:
        raise ConfigurationError(f"{path} is not a configuration of a run: {error}") from None
