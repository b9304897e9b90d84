"""Where a trained policy's weights are: a run's last checkpoint, or a certain one."""

from dataclasses import dataclass
from pathlib import Path

from mbot_workstation.training.learning.checkpoint import STATE_FILE
from mbot_workstation.training.learning.run_directory import RunDirectory


@dataclass(frozen=True, slots=True)
class Source:
    """A checkpoint and the run it belongs to."""

    run: RunDirectory
    checkpoint: Path


def find_source(path: Path) -> Source:
    """The checkpoint that a path means: a run's last one, or the folder of one.

    Raises:
        ConfigurationError: it is neither.

    """
    if (path / STATE_FILE).is_file():
        return Source(RunDirectory.open(path.resolve().parent.parent), path)
    run = RunDirectory.open(path)
    return Source(run, run.last_checkpoint())
