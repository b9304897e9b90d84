"""What a recording holds: runs, each with what the robot was told and where it went."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.maneuver import SLOW
from mbot_workstation.measure.tracks.track import Array, Track


@dataclass(frozen=True, slots=True, eq=False)
class CommandSeries:
    """What both motors were told; each row holds until the next.

    Before the first row and from the last one on, which is 0, 0, the robot stands.

    Attributes:
        time_s: on the robot's clock, shape (n,), rising.
        left, right: actions in [-1, 1], 1 is full speed forward (motor step / 250), shape (n,).

    Raises:
        ValueError: shapes differ, a value is out of range, time does not rise, or the last row
            does not stop the robot.

    """

    time_s: Array
    left: Array
    right: Array

    def __post_init__(self) -> None:
        if not self.time_s.shape == self.left.shape == self.right.shape == (len(self.time_s),):
            raise ValueError("time_s, left and right differ in shape")
        if len(self.time_s) < 2:
            raise ValueError(f"there are {len(self.time_s)} rows, expected at least 2")
        if not (np.isfinite(self.time_s).all() and (np.diff(self.time_s) > 0).all()):
            raise ValueError("time_s does not rise")
        for name, values in (("left", self.left), ("right", self.right)):
            if not (np.abs(values) <= 1).all():  # NaN fails as well
                raise ValueError(f"{name} holds a value outside [-1, 1]")
        if not self._driving.any():
            raise ValueError("both motors are 0 throughout")
        if self._driving[-1]:
            raise ValueError("the last row is not 0, 0, so nobody knows when the robot stopped")

    @property
    def start_s(self) -> float:
        """When the first motor was told to turn."""
        return float(self.time_s[int(np.argmax(self._driving))])

    @property
    def end_s(self) -> float:
        """When both were told to stop, for the last time."""
        last = len(self.time_s) - 1 - int(np.argmax(self._driving[::-1]))
        return float(self.time_s[last + 1])

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Left and right at these moments of the robot's clock. Shapes as `time_s`."""
        rows = np.searchsorted(self.time_s, time_s, side="right") - 1
        before = rows < 0
        return (
            np.where(before, 0.0, self.left[rows]),
            np.where(before, 0.0, self.right[rows]),
        )

    @property
    def _driving(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        return (self.left != 0) | (self.right != 0)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One repetition of one maneuver.

    Attributes:
        number: as in commands.csv, unique in its recording.
        maneuver: its name, such as "forward-neutral".
        repetition: from 1.
        commands: on the robot's clock.
        track: on the tracker's clock; begins before the first command and ends after the last
            one, if the tracker ran that long.

    """

    number: int
    maneuver: str
    repetition: int
    commands: CommandSeries
    track: Track

    @property
    def is_slow(self) -> bool:
        """Whether it is the slow maneuver."""
        return self.maneuver == SLOW.name


class UnusableRunError(ConfigurationError):
    """One run of a recording can't be used; without it the others may be."""

    kind = "run-spoilt"

    @classmethod
    def of(cls, number: int, what: str) -> Self:
        """What is wrong with this run, with the remedy."""
        remedy = f"record it again, or add {number} to leave_out in recording.toml"
        return cls(what, remedy=remedy, run=number)

    @property
    def number(self) -> int:
        """Of the run, for `leave_out` in recording.toml."""
        return self.facts["run"]


@dataclass(frozen=True, slots=True, eq=False)
class ManeuverRecording:
    """All runs of a folder.

    Attributes:
        robot_id: whose.
        wheel_maps: how the daemon turned actions into board speeds when it was recorded.
        runs: in the order they were driven; at least one.
        tracker_ahead_s: if one track spans all runs: the tracker's clock minus the robot's, to
            about 0.1 s, and the same for every run. None if each run has a track file of its own,
            whose clock may begin anywhere.

    """

    robot_id: str
    wheel_maps: WheelMaps
    runs: tuple[Run, ...]
    tracker_ahead_s: float | None = None


def common_robot(recordings: Sequence[ManeuverRecording]) -> str:
    """Whose all recordings are; raises ConfigurationError if they differ."""
    names = list(dict.fromkeys(recording.robot_id for recording in recordings))
    if len(names) > 1:
        raise ConfigurationError(
            f"the recordings are of {' and '.join(names)}; identify one robot at a time, or say "
            "with --robot whose they are",
            kind="several-robots",
            robots=names,
        )
    return names[0]


def common_wheel_maps(recordings: Sequence[ManeuverRecording]) -> WheelMaps:
    """The latest recording's; raises ConfigurationError if they differ in a motor's direction."""
    maps = [recording.wheel_maps for recording in recordings]
    if len({(one.left.reversed, one.right.reversed) for one in maps}) > 1:
        raise ConfigurationError(
            "the recordings differ in which motor is reversed (recording.toml); identify them one "
            "by one",
            kind="motors-differ",
        )
    return maps[-1]
