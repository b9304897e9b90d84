"""The simulated robot as a Gymnasium environment, for a policy or a training of one's own."""

from typing import TYPE_CHECKING, Any

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError

if TYPE_CHECKING:
    import gymnasium


def make_env(
    preset: str = "nominal",
    lesson: str | None = None,
    task: str = "fetch",
    seed: int | None = None,
    render_mode: str | None = None,
) -> "gymnasium.Env[Picture, Any]":
    """One robot in its arena. A step is a decision of 0.4 s; close it in the end.

    Observation: shape (64, 64, 3), uint8, RGB, what the policy sees. Action: shape (2,), float32,
    left and right wheel in [-1, 1]. `step` returns picture, reward, whether the episode has ended,
    False (none is cut off) and the task's facts, all of them truth that no robot knows.

    Args:
        preset: which robots, rooms and light, as `workstation evaluate --preset`: "nominal",
            "randomised", "home" and so on.
        lesson: of the task, by its name; the last of its course if not given.
        task: its name, or the path of a file, which is run.
        seed: fixes all that is random from the first episode on, as `reset(seed=...)` does.
        render_mode: "rgb_array": `render()` returns the last observation.

    Raises:
        ConfigurationError: no such preset, lesson or task, or a library is missing.

    """
    try:
        from mbot_workstation.learn.worlds.task_env import TaskEnv
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f"make_env needs {error.name}",
            remedy="pip install -c constraints.txt -e '.[train]' in the checkout",
        ) from None
    try:
        env = TaskEnv(preset, lesson, render_mode=render_mode, task=task)
    except ValueError as error:
        raise ConfigurationError(f"make_env: {error}") from None
    if seed is not None:
        env.reset(seed=seed)
    return env
