"""One decision of a robot as a program reads it, live or from a recording."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.beat import beat as protocol
from mbot_protocol.beat.fields import state_word
from mbot_protocol.drive.picture import Picture
from mbot_workstation.wording import fault_lines


@dataclass(frozen=True, slots=True)
class Beat:
    """What a robot saw and did at one beat of its loop, 2.5 times a second.

    Attributes:
        raw: all that is known of it; `raw.decision` has every field of telemetry by its name in
            docs/telemetry.md.

    """

    raw: protocol.Beat

    @property
    def number(self) -> int:
        """Counts from 0 since the robot's software started."""
        return self.raw.decision.sequence

    @property
    def unix_s(self) -> float:
        """When it was, by the robot's wall clock; for people, it may jump."""
        return self.raw.decision.unix_time_ns / 1e9

    @property
    def monotonic_s(self) -> float:
        """When it began, by the robot's monotonic clock: for differences."""
        return self.raw.decision.started_monotonic_ns / 1e9

    @property
    def state(self) -> str:
        """As in `RobotState`."""
        return state_word(self.raw.decision.state)

    @property
    def faults(self) -> tuple[str, ...]:
        """What was wrong, each in a line."""
        return tuple(fault_lines(self.raw.decision.faults))

    @property
    def action(self) -> tuple[float, float] | None:
        """What the policy said: left and right wheel in [-1, 1]; None where it wasn't asked."""
        action = self.raw.decision.action
        return (action.left, action.right) if self.raw.decided else None

    @property
    def frame(self) -> Picture | None:
        """What the policy saw, shape (64, 64, 3), uint8, RGB; None where there is no picture.

        Live it is a JPEG that was decoded, on the robot's own recordings it is exact.
        """
        from mbot_workstation.pictures.picture_file import observation

        return observation(self.raw)


def read_recording(path: Path | str) -> Iterator[Beat]:
    """The beats of a recording, in order: a file, or a folder of them as a robot writes it.

    Raises:
        ConfigurationError: there is none, or nothing in it is whole.

    """
    from mbot_protocol.beat.recorded_drive import read_drive

    return (Beat(beat) for beat in read_drive(Path(path)).beats)
