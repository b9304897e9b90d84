"""What a live recording lacks, taken from the robot's own: a link may lose records, a card not.

Both count beats alike (the daemon's life and the beat's number in it), so what is missing is known
exactly, and nothing is guessed. A robot writes its own from arming to 3 s after the stop only:
what was lost while it stood stays lost.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.channels import RobotFacts
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile

_CLOCK_SLACK_NS = 10_000_000_000
"""A drive's times are those of its files; they may lie beside those of its beats."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Beats that are missing between two of the same life of a daemon.

    Attributes:
        session_id: that life.
        first, last: numbers of what is missing.
        from_unix_ns, until_unix_ns: when the beats on both sides were.

    """

    session_id: int
    first: int
    last: int
    from_unix_ns: int
    until_unix_ns: int

    @property
    def count(self) -> int:
        """How many beats are missing."""
        return self.last - self.first + 1

    def may_be_in(self, began_unix_ns: int, ended_unix_ns: int) -> bool:
        """Whether a drive of these times may have some of them."""
        began, ended = began_unix_ns - _CLOCK_SLACK_NS, ended_unix_ns + _CLOCK_SLACK_NS
        return self.from_unix_ns <= ended and began <= self.until_unix_ns


@dataclass(frozen=True, slots=True)
class Filled:
    """A recording whose gaps were filled as far as possible.

    Attributes:
        beats: all of them, each daemon's life in its order.
        decisions: beats that were missing and are there now.
        pictures: pictures that beats lacked and have now, those of `decisions` not counted.
        facts: which robot, where its recordings tell.
        still_missing: beats that the robot's recordings lack as well.

    """

    beats: tuple[Beat, ...]
    decisions: int
    pictures: int
    still_missing: int
    facts: RobotFacts | None = None


def gaps(beats: Iterable[Beat]) -> list[Gap]:
    """What is missing between the first and the last beat of each life."""
    lives: dict[int, list[Beat]] = {}
    for beat in beats:
        lives.setdefault(beat.decision.session_id, []).append(beat)
    return [
        Gap(
            session_id,
            before.decision.sequence + 1,
            after.decision.sequence - 1,
            before.decision.unix_time_ns,
            after.decision.unix_time_ns,
        )
        for session_id, life in lives.items()
        for before, after in pairwise(sorted(life, key=lambda beat: beat.decision.sequence))
        if after.decision.sequence > before.decision.sequence + 1
    ]


def fill(live: Sequence[Beat], robots: Iterable[RecordedDrive]) -> Filled:
    """Take from the robot's own recordings what is missing among the live beats.

    Beats that both have take over what only the robot knows: what the policy saw to the last bit,
    what it had in mind. So what was filled can be replayed as far as the robot's own reaches.
    """
    robot_id = live[0].decision.robot_id
    known = {beat.key: beat for beat in live}
    wanted = {
        (gap.session_id, sequence)
        for gap in gaps(live)
        for sequence in range(gap.first, gap.last + 1)
    }
    decisions, pictures, facts = 0, 0, None
    for drive in robots:
        for beat in drive.beats:
            key = beat.key
            if beat.decision.robot_id != robot_id:
                continue
            there = known.get(key)
            if there is not None:
                pictures += not there.encoded and bool(beat.encoded)
                known[key] = _richer(there, beat)
                facts = facts or drive.facts
            elif key in wanted:
                known[key] = beat
                decisions += 1
                facts = facts or drive.facts
    lives = list(dict.fromkeys(beat.decision.session_id for beat in live))
    in_order = sorted(known.items(), key=lambda item: (lives.index(item[0][0]), item[0][1]))
    beats = tuple(beat for _, beat in in_order)
    return Filled(beats, decisions, pictures, len(wanted) - decisions, facts)


def _richer(live: Beat, robots: Beat) -> Beat:
    """The live beat with what the robot's own has more of."""
    if robots.policy_input is not None:
        live = replace(live, policy_input=robots.policy_input)
    if robots.encoded and not live.is_exact:
        live = replace(live, encoded=robots.encoded, is_exact=robots.is_exact)
    return live


def write(path: Path, filled: Filled) -> None:
    """Write a filled recording; raises ConfigurationError as `TelemetryFile`."""
    robot_id = filled.beats[0].decision.robot_id
    with TelemetryFile(path, robot_id, facts=filled.facts) as file:
        for beat in filled.beats:
            file.write(beat)
