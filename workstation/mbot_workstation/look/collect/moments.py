"""What of a drive is worth a look: who took over, what was marked, where hand and policy differ."""

from collections.abc import Sequence
from dataclasses import dataclass

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.pictures.picture_file import observation
from mbot_workstation.wording import one_line

SHAPE = (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of a drive, in s from its begin, and what it was."""

    since_s: float
    until_s: float
    words: str


@dataclass(frozen=True, slots=True)
class Difference:
    """A beat in which a person did something else than the policy would have.

    Attributes:
        beat: which.
        hand, policy: wheels in [-1, 1].

    """

    beat: Beat
    hand: tuple[float, float]
    policy: tuple[float, float]

    @property
    def size(self) -> float:
        """Of the wheel that differs more."""
        return max(abs(a - b) for a, b in zip(self.hand, self.policy, strict=True))


def interventions(drive: RecordedDrive) -> list[Stretch]:
    """When a person drove, without a break and by the same hand."""
    found: list[Stretch] = []
    before: Beat | None = None
    for beat in drive.beats:
        if not beat.by_hand:
            before = None
            continue
        since_s = drive.since_s(beat)
        name = one_line(beat.decision.driven_by) or "somebody"
        if before is not None and before.decision.driven_by == beat.decision.driven_by:
            since_s = found.pop().since_s
        found.append(Stretch(since_s, drive.since_s(beat), f"{name} drove by hand"))
        before = beat
    return found


def marks(drive: RecordedDrive) -> list[Stretch]:
    """What was said to be wrong while it happened."""
    return [
        Stretch(
            max(0.0, drive.since_s(beat) - beat.decision.wrong_ms / 1000),
            drive.since_s(beat),
            f"{one_line(beat.decision.wrong_says) or 'somebody'} says that this was wrong",
        )
        for beat in drive.beats
        if beat.decision.HasField("wrong_ms")
    ]


def is_marked(drive: RecordedDrive, moments: Sequence[Stretch], beat: Beat) -> bool:
    """Whether a beat lies in one of these."""
    return any(one.since_s <= drive.since_s(beat) <= one.until_s for one in moments)


def differences(drive: RecordedDrive, most: int) -> list[Difference]:
    """The beats in which hand and policy differ most, the largest first."""
    found = [
        Difference(beat, drive.at_wheels(beat), would_have_done(beat) or (0.0, 0.0))
        for beat in drive.beats
        if beat.by_hand and would_have_done(beat) is not None
    ]
    return sorted(found, key=lambda one: -one.size)[:most]


def seen_by_policy(beat: Beat) -> Picture | None:
    """What the policy saw, 64 x 64; None where there is none, or a stranger's of another size."""
    try:
        seen = observation(beat) if beat.encoded else None
    except ConfigurationError:
        return None
    return seen if seen is not None and seen.shape == SHAPE else None


def would_have_done(beat: Beat) -> tuple[float, float] | None:
    """The policy's answer while a person drove, clipped as its actions are; None: it has none."""
    answer = beat.decision.would_have_done
    if not beat.decision.HasField("would_have_done"):
        return None
    return max(-1.0, min(1.0, answer.left)), max(-1.0, min(1.0, answer.right))
