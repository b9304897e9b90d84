"""A recorded drive, beat by beat: from the robot's card, or from `telemetry --record`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import DecodeError

from mbot_protocol.beat.beat import Beat, PolicyInput, read_decision
from mbot_protocol.beat.channels import (
    DECISION_TOPIC,
    DRIVE_TOPIC,
    LOG_TOPIC,
    OBSERVATION_TOPIC,
    ROBOT_METADATA,
    RobotFacts,
)
from mbot_protocol.beat.whole_chunks import WholeChunks
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """A whole recording.

    Attributes:
        paths: its files, in order.
        facts: which robot; None where the recording does not say.
        beats: in order, of one daemon's life or several.
        log: times, Unix ns, and lines for people.
        words: what of the files could be read, where that is not all.

    """

    paths: tuple[Path, ...]
    facts: RobotFacts | None
    beats: tuple[Beat, ...]
    log: tuple[tuple[int, str], ...] = ()
    words: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """What people call it: the folder of a drive, or the file."""
        first = self.paths[0]
        return first.parent.name if first.stem.isdecimal() else first.stem

    @property
    def robot_id(self) -> str:
        """Which robot."""
        return self.beats[0].decision.robot_id

    @property
    def duration_s(self) -> float:
        """From the first beat to the last, by the robot's monotonic clock."""
        first, last = self.beats[0].decision, self.beats[-1].decision
        return (last.started_monotonic_ns - first.started_monotonic_ns) / 1e9

    @property
    def decided(self) -> list[Beat]:
        """The beats in which the policy drove."""
        return [beat for beat in self.beats if beat.decided]

    def at_wheels(self, beat: Beat) -> tuple[float, float]:
        """What the wheels were told in a beat, left and right in [-1, 1], by whom ever."""
        return beat.at_wheels(self.facts.wheels if self.facts is not None else None)

    def since_s(self, beat: Beat) -> float:
        """When a beat began, from the first one's begin."""
        first = self.beats[0].decision.started_monotonic_ns
        return (beat.decision.started_monotonic_ns - first) / 1e9


def read_drive(given: Path) -> RecordedDrive:
    """Read a recording.

    Args:
        given: a file, or a folder of files as a robot writes them.

    Raises:
        ConfigurationError: there is none, or nothing in it is whole.

    """
    paths = tuple(sorted(given.glob("*.mcap"), key=_order)) if given.is_dir() else (given,)
    if not paths:
        raise ConfigurationError(f"folder {given} holds no recording (no .mcap file)")
    gathered = _Gathered()
    for path in paths:
        gathered.read(path)
    beats = tuple(gathered.beats())
    if not beats:
        found = "; ".join(gathered.words) or "they hold no decisions of a robot"
        raise ConfigurationError(f"nothing to be seen in {given}: {found}")
    return RecordedDrive(paths, gathered.facts, beats, tuple(gathered.log), tuple(gathered.words))


@dataclass(slots=True)
class _Gathered:
    """What has been read so far. A beat's messages share their time."""

    facts: RobotFacts | None = None
    log: list[tuple[int, str]] = field(default_factory=list[tuple[int, str]])
    words: list[str] = field(default_factory=list[str])
    _decisions: dict[int, Decision] = field(default_factory=dict[int, Decision])
    _inputs: dict[int, PolicyInput] = field(default_factory=dict[int, PolicyInput])
    _pictures: dict[int, CompressedImage] = field(default_factory=dict[int, CompressedImage])

    def read(self, path: Path) -> None:
        """Take in what is whole of a file."""
        chunks = WholeChunks(path)
        for message in chunks.messages():
            kind, time_ns = message.topic.rpartition("/")[2], message.log_time_ns
            try:
                if kind == DECISION_TOPIC:
                    self._decisions[time_ns] = read_decision(message.data)
                elif kind == OBSERVATION_TOPIC:
                    self._pictures[time_ns] = CompressedImage.FromString(message.data)
                elif kind == DRIVE_TOPIC:
                    # Of the decision's own fields it has nothing that the decision lacks.
                    self._inputs[time_ns] = msgspec.json.decode(message.data, type=PolicyInput)
                elif kind == LOG_TOPIC:
                    self.log.append((time_ns, Log.FromString(message.data).message))
            except (DecodeError, msgspec.MsgspecError):
                continue  # of telemetry, of another program, or of a later version
        if ROBOT_METADATA in chunks.metadata and self.facts is None:
            try:
                self.facts = RobotFacts.from_strings(chunks.metadata[ROBOT_METADATA])
            except ValueError:
                self.facts = None
        if not chunks.is_whole:
            self.words.append(f"{path.name}: {chunks.words}")

    def beats(self) -> Iterator[Beat]:
        """All beats in the order of their times."""
        for time_ns, decision in self._decisions.items():
            picture = self._pictures.get(time_ns, CompressedImage())
            yield Beat(
                decision,
                self._inputs.get(time_ns),
                encoded=picture.data,
                is_exact=picture.format == "png",
            )


def read_drives(given: Sequence[Path]) -> list[RecordedDrive]:
    """Several recordings, as `read_drive`."""
    return [read_drive(path) for path in given]


def _order(path: Path) -> tuple[int, str]:
    return len(path.name), path.name
