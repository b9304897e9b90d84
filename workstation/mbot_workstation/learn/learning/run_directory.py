"""A training run on disk: what it was told, how it went, where it can go on.

runs/<name>/config.json       resolved configuration
runs/<name>/git.json          state of the code
runs/<name>/progress.csv      a row every 40,000 decisions, as the paper logged
runs/<name>/checkpoints/      the last two
runs/<name>/tensorboard/
"""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.wording import typed

KEPT_CHECKPOINTS = 2
"""The last one, and the one before in case a disk lied about the last."""

CANDIDATES_FROM = 0.8
"""Share of a run's decisions after which every checkpoint is kept; one becomes its policy."""

UNFINISHED = ".unfinished"


@dataclass(frozen=True, slots=True)
class RunDirectory:
    """The folder of one run."""

    path: Path

    @classmethod
    def create(cls, path: Path) -> "RunDirectory":
        """Make the folder of a new run.

        Raises:
            ConfigurationError: it exists already, or can't be made.

        """
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            raise ConfigurationError(
                f"{path} exists already; choose another --name, or go on with "
                f"--resume {typed(path)}"
            ) from None
        except OSError as error:
            raise ConfigurationError(f"can't make {path}: {error.strerror}") from None
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> "RunDirectory":
        """The folder of an earlier run.

        Raises:
            ConfigurationError: this is not a run.

        """
        run = cls(path)
        if not run.config_file.is_file():
            raise ConfigurationError(
                f"{path} is not a training run (it has no {run.config_file.name}); expected the "
                "folder that `workstation train` made, such as runs/first"
            )
        return run

    @property
    def config_file(self) -> Path:
        """The resolved configuration."""
        return self.path / "config.json"

    @property
    def git_file(self) -> Path:
        """The state of the code."""
        return self.path / "git.json"

    @property
    def progress_file(self) -> Path:
        """How it went."""
        return self.path / "progress.csv"

    @property
    def curve_file(self) -> Path:
        """The same as a picture."""
        return self.path / "curve.png"

    @property
    def choice_file(self) -> Path:
        """Which checkpoint is the run's policy, and what the others were worth."""
        return self.path / "choice.json"

    @property
    def tensorboard(self) -> Path:
        """Folder for TensorBoard."""
        return self.path / "tensorboard"

    def forget_unless_begun(self) -> None:
        """Delete the folder if there is no checkpoint in it: it would only block its name."""
        if not self.checkpoints():
            shutil.rmtree(self.path, ignore_errors=True)

    def checkpoints(self) -> list[Path]:
        """The whole checkpoints, oldest first."""
        folder = self.path / "checkpoints"
        if not folder.is_dir():
            return []
        return sorted(entry for entry in folder.iterdir() if entry.name.isdecimal())

    @property
    def average(self) -> Path:
        """The mean of its last checkpoints, once it has been chosen from: not to go on from."""
        return self.path / "checkpoints" / "average"

    def last_checkpoint(self) -> Path:
        """The checkpoint to go on from.

        Raises:
            ConfigurationError: there is none yet.

        """
        checkpoints = self.checkpoints()
        if not checkpoints:
            raise ConfigurationError(f"{self.path} has no checkpoint yet; train it again")
        return checkpoints[-1]

    def add_checkpoint(
        self, step: int, write: Callable[[Path], None], kept_from: int | None = None
    ) -> Path:
        """Add a checkpoint, or nothing at all if the machine dies meanwhile.

        Args:
            step: decisions so far.
            write: puts the checkpoint's files into the folder it is given.
            kept_from: checkpoints of this step and later ones are all kept.

        Raises:
            ConfigurationError: the disk is full or gone; the checkpoints before are whole.

        """
        final = self.path / "checkpoints" / f"{step:09d}"
        self._add(final, write)
        for old in self.checkpoints()[:-KEPT_CHECKPOINTS]:
            if kept_from is None or int(old.name) < kept_from:
                shutil.rmtree(old)
        return final

    def add_average(self, write: Callable[[Path], None]) -> Path:
        """Add the average, or put it in the place of an older one; as `add_checkpoint`."""
        self._add(self.average, write)
        return self.average

    def _add(self, final: Path, write: Callable[[Path], None]) -> None:
        folder, unfinished = final.parent, final.with_suffix(UNFINISHED)
        shutil.rmtree(unfinished, ignore_errors=True)
        try:
            unfinished.mkdir(parents=True)
            write(unfinished)
            for file in unfinished.iterdir():
                _to_disk(file)
            shutil.rmtree(final, ignore_errors=True)
            unfinished.rename(final)
            _to_disk(folder)
        except (OSError, RuntimeError) as error:  # torch has no type of its own for a full disk
            shutil.rmtree(unfinished, ignore_errors=True)
            reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
            resume = f"go on with --resume {typed(self.path)}"
            then = resume if self.checkpoints() else "begin again"
            raise ConfigurationError(
                f"can't save a checkpoint in {folder}: {reason}; make room there, then {then}"
            ) from None


def first_candidate(steps: int) -> int:
    """The decision from which on checkpoints may become the policy of a run of so many."""
    return int(CANDIDATES_FROM * steps)


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file that a person can read too."""
    atomic_file.save(path, (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode())


def _to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
