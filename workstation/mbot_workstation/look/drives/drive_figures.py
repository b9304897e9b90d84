"""What happened in a recorded drive, in numbers and in a sentence."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.beat.stages import SPANS, percentile, span_ms
from mbot_protocol.v1.messages_pb2 import State
from mbot_workstation.wording import one_line, short_digest

HISTOGRAM_BINS = 40

_AGO = re.compile(r" [\d.]+ s ago")


@dataclass(frozen=True, slots=True)
class Latency:
    """One stage of all decisions: how long it took, in ms."""

    name: str
    values_ms: tuple[float, ...]

    def share_ms(self, share: float) -> float:
        """What this share of the decisions did not exceed."""
        return percentile(self.values_ms, share)

    def histogram(self, until_ms: float) -> list[int]:
        """Counts in equal bins from 0; the last one holds what is longer, too."""
        counts = [0] * HISTOGRAM_BINS
        for value in self.values_ms:
            place = int(max(0.0, value) / until_ms * HISTOGRAM_BINS) if until_ms > 0 else 0
            counts[min(place, HISTOGRAM_BINS - 1)] += 1
        return counts


@dataclass(frozen=True, slots=True)
class DriveFigures:
    """One drive.

    Attributes:
        drive: the recording.
        models: digests of what drove, in order.
        missed_beats, lost_records: within this recording.
        driving_s: how long the policy drove.
        hands: how long somebody drove by hand, in s, by their names.
        faults: since when in s, kind and detail, each time one appeared.
        latencies: of the stages that happened.

    """

    drive: RecordedDrive
    models: tuple[str, ...]
    missed_beats: int
    lost_records: int
    driving_s: float
    hands: Mapping[str, float]
    faults: tuple[tuple[float, str, str], ...]
    latencies: tuple[Latency, ...]

    @property
    def began(self) -> str:
        """By the robot's clock, in this computer's time zone."""
        began_s = self.drive.beats[0].decision.unix_time_ns / 1e9
        return f"{datetime.fromtimestamp(began_s):%Y-%m-%d %H:%M:%S}"

    @property
    def sentence(self) -> str:
        """What happened, for somebody who was not there."""
        count, said = len(self.drive.decided), list[str]()
        by = " and then ".join(short_digest(model) for model in self.models)
        if count:
            said.append(f"driven for {self.driving_s:.1f} s by {by}, {count} decisions")
        said += [
            f"driven by hand by {one_line(name) or 'somebody'} for {time_s:.1f} s"
            for name, time_s in self.hands.items()
        ]
        start = f"{self.drive.robot_id} was {', '.join(said) or 'not driven by a policy'}"
        missed = f"{self.missed_beats} beats missed" if self.missed_beats else "no beat missed"
        kinds = list(dict.fromkeys(kind for _, kind, _ in self.faults))
        faults = f"; in the way: {', '.join(kinds)}" if kinds else ""
        return f"{start}, {missed}{faults}. {self.end}"

    @property
    def end(self) -> str:
        """How it ended."""
        last = self.drive.beats[-1].decision
        if last.state in (State.STATE_RUNNING, State.STATE_MANUAL):
            return "The recording ends while it still drives."
        stops = [words for _, words in self.drive.log if re.match("stopped[ :]", words)]
        if stops:
            return f"It was {one_line(_AGO.sub('', stops[-1]))}."
        return f"In the end it was {State.Name(last.state).removeprefix('STATE_').lower()}."

    @property
    def wheels(self) -> list[tuple[float, float, float]]:
        """Seconds, left and right wheel as a share of full speed, of every beat."""
        return [
            (self.drive.since_s(beat), *self.drive.at_wheels(beat)) for beat in self.drive.beats
        ]

    def chosen(self, most: int) -> list[Beat]:
        """Beats with pictures, evenly over the drive."""
        seen = [beat for beat in self.drive.beats if beat.encoded]
        if len(seen) <= most:
            return seen
        return [seen[round(k * (len(seen) - 1) / (most - 1))] for k in range(most)]


def figures(drive: RecordedDrive) -> DriveFigures:
    """Count and measure a drive."""
    decisions = [beat.decision for beat in drive.beats]
    first, last = decisions[0], decisions[-1]
    period_s = 1 / drive.facts.decision_rate_hz if drive.facts is not None else 0.4
    spans = [span_ms(beat.decision) for beat in drive.decided]
    latencies = [
        Latency(one.name, tuple(span[one.name] for span in spans if one.name in span))
        for one in SPANS
    ]
    return DriveFigures(
        drive,
        tuple(dict.fromkeys(beat.decision.model_sha256 for beat in drive.decided)),
        max(0, last.missed_ticks - first.missed_ticks),
        _lost(drive.beats),
        len(drive.decided) * period_s,
        {name: beats * period_s for name, beats in _hands(drive).items()},
        _faults(drive),
        tuple(latency for latency in latencies if latency.values_ms),
    )


def _hands(drive: RecordedDrive) -> Counter[str]:
    """Beats that somebody drove by hand, by their names; empty: by a release that did not tell."""
    return Counter(beat.decision.driven_by for beat in drive.beats if beat.by_hand)


def _lost(beats: Sequence[Beat]) -> int:
    """Beats of the drive that the recording lacks."""
    known = sorted({beat.decision.sequence for beat in beats})
    return known[-1] - known[0] + 1 - len(known)


def _faults(drive: RecordedDrive) -> tuple[tuple[float, str, str], ...]:
    found: list[tuple[float, str, str]] = []
    before: set[str] = set()
    for beat in drive.beats:
        now = {fault.kind for fault in beat.decision.faults}
        found += [
            (drive.since_s(beat), one_line(fault.kind), one_line(fault.detail))
            for fault in beat.decision.faults
            if fault.kind not in before
        ]
        before = now
    return tuple(found)
