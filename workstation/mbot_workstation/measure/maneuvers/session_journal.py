"""The recording's folder while it grows: whole after every run, so that nothing is lost."""

from collections.abc import Sequence
from pathlib import Path

import msgspec

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.commands_csv import CommandedRun, read_commands, write_commands
from mbot_workstation.measure.tracks.maneuver import Maneuver
from mbot_workstation.measure.tracks.recording_folder import COMMANDS_FILE, TELEMETRY_FILE
from mbot_workstation.measure.tracks.recording_toml import (
    RECORDING_FILE,
    RecordingInfo,
    read_info,
    write_info,
)
from mbot_workstation.measure.tracks.run import CommandSeries
from mbot_workstation.wording import typed

SAME_START_S = 60.0
"""The moment of the robot's start, worked out twice, differs by less unless it was restarted."""


class Journal:
    """Keeps recording.toml and commands.csv.

    Attributes:
        folder: where.
        runs: recorded so far, in order.

    """

    def __init__(self, folder: Path, info: RecordingInfo, runs: Sequence[CommandedRun]) -> None:
        self.folder = folder
        self.runs = list(runs)
        self._info = info
        self._next_number = max((run.number for run in runs), default=0) + 1

    @classmethod
    def create(
        cls, folder: Path, robot_id: str, wheel_maps: WheelMaps, made_on: str, started_unix_s: float
    ) -> "Journal":
        """A new recording.

        Args:
            folder: must not hold a recording yet.
            robot_id: whose.
            wheel_maps: of its daemon.
            made_on: ISO date.
            started_unix_s: the wall clock's time when the robot's clock began.

        Raises:
            ConfigurationError: there is one already, or the folder can't be made.

        """
        if (folder / RECORDING_FILE).exists():
            raise ConfigurationError(
                f"{folder} holds a recording already; go on with it by "
                f"--resume {typed(folder)}, or choose another --output"
            )
        info = RecordingInfo(
            robot_id, made_on, started_unix_s, left=wheel_maps.left, right=wheel_maps.right
        )
        journal = cls(folder, info, ())
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigurationError(f"can't make {folder}: {error.strerror}") from None
        journal.save()
        return journal

    @classmethod
    def resume(cls, folder: Path, robot_id: str, started_unix_s: float) -> "Journal":
        """An earlier recording, to go on with.

        Raises:
            ConfigurationError: it is another robot's, or the robot has been restarted since, so
                that its clock started over.

        """
        info = read_info(folder)
        if info.robot_id != robot_id:
            raise ConfigurationError(
                f"{folder} is a recording of {info.robot_id}, this robot is {robot_id}"
            )
        moved_s = abs(started_unix_s - info.clock_began_unix_s)
        if info.clock_began_unix_s and moved_s > SAME_START_S:
            raise ConfigurationError(
                f"{folder}: the robot has been restarted since, and its clock with it; record the "
                "rest into a new folder"
            )
        path = folder / COMMANDS_FILE
        return cls(folder, info, read_commands(path, may_be_empty=True))

    @property
    def recorded(self) -> set[tuple[str, int]]:
        """Maneuver and repetition of what is there."""
        return {(run.maneuver, run.repetition) for run in self.runs}

    def next_number(self) -> int:
        """A number for the next attempt; a spoilt run's is not used again."""
        self._next_number += 1
        return self._next_number - 1

    def add(
        self,
        number: int,
        maneuver: Maneuver,
        repetition: int,
        commands: CommandSeries,
        uncertainty_s: float = 0.0,
    ) -> None:
        """Keep a run.

        Raises:
            ConfigurationError: the disk is full or gone.

        """
        self.runs.append(CommandedRun(number, maneuver.name, repetition, commands))
        worst_ms = max(self._info.clock_uncertainty_ms, round(uncertainty_s * 1000, 2))
        self._info = msgspec.structs.replace(self._info, clock_uncertainty_ms=worst_ms)
        self.save()

    def remove_last(self) -> CommandedRun | None:
        """Forget the last run, which was spoilt; None if there is none."""
        if not self.runs:
            return None
        run = self.runs.pop()
        self.save()
        return run

    def telemetry_path(self) -> Path:
        """A name for telemetry that is not taken yet."""
        path = self.folder / TELEMETRY_FILE
        part = 2
        while path.exists():
            path = self.folder / f"telemetry-{part}.mcap"
            part += 1
        return path

    def save(self) -> None:
        """Write both files; each is whole at any moment.

        Raises:
            ConfigurationError: the folder can't be written.

        """
        try:
            write_info(self.folder, self._info)
            write_commands(self.folder / COMMANDS_FILE, self.runs)
        except OSError as error:
            raise ConfigurationError(
                f"can't write to {self.folder}: {error.strerror}; what was saved can be read"
            ) from None
