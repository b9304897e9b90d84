"""What has kept robots from driving, by the drives that they have recorded."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_workstation.wording import duration, one_line


@dataclass(frozen=True, slots=True)
class FaultSeen:
    """One fault, from the beat that first had it to the one that no longer did.

    Attributes:
        robot_id, drive: where.
        kind, detail: as the robot told it first.
        began_unix_time_ns: by the robot's clock.
        lasted_s: until it was gone, or until the drive ended.

    """

    robot_id: str
    drive: str
    kind: str
    detail: str
    began_unix_time_ns: int
    lasted_s: float

    def cells(self) -> tuple[str, ...]:
        """For a table."""
        from datetime import datetime

        began = datetime.fromtimestamp(self.began_unix_time_ns / 1e9)
        when = (f"{began:%Y-%m-%d %H:%M:%S}", duration(self.lasted_s))
        return (*when, one_line(self.robot_id), one_line(self.kind), one_line(self.detail))


def faults_in(drives: Iterable[Path]) -> list[FaultSeen]:
    """Of all of these, the newest first.

    Raises:
        ConfigurationError: one can't be read.

    """
    found = [fault for path in drives for fault in _faults_of(read_drive(path))]
    return sorted(found, key=lambda fault: fault.began_unix_time_ns, reverse=True)


def _faults_of(drive: RecordedDrive) -> Iterator[FaultSeen]:
    begun: dict[str, tuple[int, str]] = {}
    now_ns = 0
    for beat in drive.beats:
        now_ns = beat.decision.unix_time_ns
        there = {fault.kind: fault.detail for fault in beat.decision.faults}
        for kind in [kind for kind in begun if kind not in there]:
            yield _seen(drive, kind, *begun.pop(kind), now_ns)
        for kind, detail in there.items():
            begun.setdefault(kind, (now_ns, detail))
    for kind, (began_ns, detail) in begun.items():
        yield _seen(drive, kind, began_ns, detail, now_ns)


def _seen(drive: RecordedDrive, kind: str, began_ns: int, detail: str, end_ns: int) -> FaultSeen:
    lasted_s = round(max(0, end_ns - began_ns) / 1e9, 1)
    return FaultSeen(drive.robot_id, drive.name, kind, detail, began_ns, lasted_s)
