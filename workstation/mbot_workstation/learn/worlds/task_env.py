"""A task as a Gymnasium environment; `MBot/FetchObject-v0` is the paper's.

Import this module, then `gymnasium.make("MBot/FetchObject-v0", preset="nominal", lesson="10")`.
"""

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.learn.worlds.robot_eye import RobotEye
from mbot_workstation.learn.worlds.world import World
from mbot_workstation.learn.worlds.world_settings import world_settings
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task
from mbot_workstation.tasks.lesson import Lesson

ENV_ID = "MBot/FetchObject-v0"

Action = NDArray[np.float32]


def observation_space() -> Box[Any]:
    """What the policy contract says, without the batch."""
    return Box(0, 255, (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3), np.uint8)


def action_space() -> Box[Any]:
    """Left and right wheel."""
    return Box(-1.0, 1.0, (2,), np.float32)


class TaskEnv(gymnasium.Env[Any, Any]):
    """One robot. A step is a decision of 0.4 s.

    Whatever ends an episode terminates it, a time-out too, as in the paper: the timer is a part of
    the task, with a penalty of its own, not a limit of the simulation. So nothing is truncated.

    Attributes:
        world: robot, arena and task.
        lesson: of the next episode.

    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 2.5}  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(
        self,
        preset: str | EffectRanges = "nominal",
        lesson: str | Lesson | None = None,
        rooms: Sequence[Picture] | None = None,
        robot: RobotParameters | None = None,
        scene: SceneParameters | None = None,
        render_mode: str | None = None,
        task: str = DEFAULT_TASK,
    ) -> None:
        """Build the world.

        Args:
            preset: the effects, by name or as ranges.
            lesson: by name or as itself; if not given the last one of its course.
            rooms: panoramas, shape (h, 2 h, 3), RGB; generated when None.
            robot: what the effects start from; the nominal one when None.
            scene: what is around it; likewise.
            render_mode: "rgb_array" renders the last observation.
            task: by its name or file.

        """
        lesson = lesson or find_task(task).course(guided=False, further=False)[-1]
        settings = world_settings(preset, lesson, rooms, robot, scene, task)
        self.observation_space = observation_space()
        self.action_space = action_space()
        self.render_mode = render_mode
        self.lesson = settings.lesson
        self.world = World(settings)
        self._eye = RobotEye(settings.rooms, settings.robot, settings.scene, settings.floors)
        self._observation: Picture | None = None
        self._is_seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Picture, dict[str, Any]]:
        """Start an episode; a seed fixes everything random from here on."""
        super().reset(seed=seed)
        if seed is not None or not self._is_seeded:
            self.world.seed(self.np_random)
            self._is_seeded = True
        self.world.begin(self.lesson)
        return self._observe(), self.world.info()

    def step(self, action: Action) -> tuple[Picture, float, bool, bool, dict[str, Any]]:
        """Drive for 0.4 s.

        Args:
            action: left and right wheel in [-1, 1], shape (2,).

        Returns:
            Picture, reward, whether the episode has ended, False (none is cut off), facts.

        """
        left, right = (float(wheel) for wheel in action)
        outcome = self.world.decide(left, right)
        info = self.world.info(outcome)
        return self._observe(), outcome.reward, outcome.ended, False, info

    def render(self) -> Picture | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The last observation, if the render mode asks for it."""
        return self._observation if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Give the OpenGL resources back."""
        self._eye.close()

    def _observe(self) -> Picture:
        self._observation = self._eye.observe(self.world)
        return self._observation


gymnasium.register(ENV_ID, entry_point=f"{__name__}:TaskEnv")
