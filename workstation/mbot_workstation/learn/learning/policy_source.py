"""Where a trained policy's weights are: what was chosen of a run, or a certain checkpoint."""

from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from mbot_workstation.learn.learning.checkpoint import STATE_FILE
from mbot_workstation.learn.learning.run_directory import RunDirectory


@dataclass(frozen=True, slots=True)
class Source:
    """A checkpoint and the run it belongs to."""

    run: RunDirectory
    checkpoint: Path


Rewards = dict[str, tuple[float, float, float]]
"""Mean reward of an episode with its 95 % interval, by a checkpoint's name or the average's."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What was chosen; JSON as it is.

    Attributes:
        chosen: the checkpoint's name, or the average's.
        tried: all of them.
        episodes: of each.
        finals: the first ones of these, once more; what counts.
        final_episodes: of each of them.

    """

    chosen: str
    tried: Rewards
    episodes: int
    finals: Rewards = field(default_factory=Rewards)
    final_episodes: int = 0


def find_source(path: Path) -> Source:
    """The checkpoint that a path means: the one chosen of a run, or the folder of one.

    Raises:
        ConfigurationError: it is neither.

    """
    if (path / STATE_FILE).is_file():
        return Source(RunDirectory.open(path.resolve().parent.parent), path)
    run = RunDirectory.open(path)
    return Source(run, chosen_checkpoint(run))


def chosen_checkpoint(run: RunDirectory) -> Path:
    """A run's policy: the chosen checkpoint, the last one if none was chosen since.

    Of a run that was kept for its policy the average may be all that is left.

    Raises:
        ConfigurationError: there is no checkpoint.

    """
    if not run.checkpoints() and (run.average / STATE_FILE).is_file():
        return run.average
    last = run.last_checkpoint()
    choice = noted_choice(run)
    if choice is None or last.name not in choice.tried:
        return last
    candidates = [*run.checkpoints(), run.average]
    return next((one for one in candidates if one.name == choice.chosen), last)


def noted_choice(run: RunDirectory) -> Choice | None:
    """What was chosen of a run; None if nothing was, or it can't be read."""
    try:
        return msgspec.json.decode(run.choice_file.read_bytes(), type=Choice)
    except (OSError, msgspec.DecodeError):
        return None
