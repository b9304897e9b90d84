"""What hands did on recorded drives: sequences with advice, rehearsed beside simulated ones.

Only what a hand did is advice. The beats of the policy before it, marked as wrong or not, are what
the memory is warmed up on: with what was seen and what the wheels were told, it comes to a hand's
beats as it would on the robot.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from torch import nn

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FULL_VIEW, OBSERVATION_SIDE_PX
from mbot_workstation.learn.learning.memory_policy import ACTIONS
from mbot_workstation.learn.learning.sequences import Sequences
from mbot_workstation.learn.learning.views import Views, seen_by
from mbot_workstation.pictures.picture_file import observation

WARM_UP = 0.5
"""Of a sequence, before the first beat that is advice, where the drive has so much before it."""

THREADS = 2

_SHAPE = (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3)


@dataclass(frozen=True, slots=True, eq=False)
class _Lived:
    """One beat: what was seen, what the wheels were told before and in it, whether by a hand."""

    picture: Picture
    told: tuple[float, float]
    wheels: tuple[float, float]
    by_hand: bool


def hands_advice(drives: Sequence[str], length: int, units: int) -> Sequences:
    """All that hands did on some drives, each beat as advice once.

    Args:
        drives: recordings of robots.
        length: of a sequence.
        units: of the memory, which is empty before each.

    Raises:
        ConfigurationError: no hand drove, a picture is not what a policy sees, or a file is none.

    """
    windows = [
        window
        for path in drives
        for stretch in _stretches(read_drive(Path(path)))
        for window in _windows(stretch, length)
    ]
    if not windows:
        raise ConfigurationError(
            f"no hand has driven in the {len(drives)} drives for training: take over where the "
            "policy is wrong (`workstation console`), or leave out --drives"
        )
    return Sequences(
        seen=np.stack([pictures for pictures, _, _ in windows], axis=1),
        previous_actions=np.stack([told for _, told, _ in windows], axis=1),
        forgot=np.eye(length, 1, dtype=np.float32).repeat(len(windows), axis=1),
        state=np.zeros((len(windows), units), np.float32),
        advice=np.stack([advice for _, _, advice in windows], axis=1),
        shows=np.zeros((length, len(windows)), np.bool_),
    )


def as_seen(lived: Sequences, network: nn.Module) -> Sequences:
    """The same with what an eye that learns no more makes of the pictures."""
    pictures = lived.seen.reshape(-1, *_SHAPE).astype(np.uint8)
    views = Views(pictures, np.empty((0, 0), np.float32), np.empty((0, 0), np.float32))
    with ThreadPoolExecutor(THREADS) as threads:
        features = seen_by(network, views, 0, threads).features
    return replace(lived, seen=features.reshape(*lived.forgot.shape, -1))


def _stretches(drive: RecordedDrive) -> Iterator[list[_Lived]]:
    """What was driven without a break, by whom ever: a break empties a policy's memory."""
    found: list[_Lived] = []
    before: Beat | None = None
    driven = [beat for beat in drive.beats if beat.decided or beat.by_hand]
    by_hand = [beat for beat in driven if beat.by_hand]
    if by_hand and not any(beat.is_replayable for beat in by_hand):
        raise ConfigurationError(
            f"{drive.name} is of telemetry, whose pictures are not exactly what the policy saw: "
            "fetch the robot's own recording (`workstation recordings fetch`)"
        )
    for beat in driven:
        seen = _seen(beat, drive.name) if beat.is_replayable else None
        if before is None or seen is None or _begins_anew(beat, before):
            yield found
            found = []
        told = drive.at_wheels(before) if before is not None and found else (0.0, 0.0)
        if seen is not None:
            found.append(_Lived(seen, told, drive.at_wheels(beat), beat.by_hand))
        before = beat
    yield found


def _begins_anew(beat: Beat, before: Beat) -> bool:
    known = beat.policy_input
    follows = beat.key == (before.key[0], before.key[1] + 1)
    return not follows or (known is not None and known.began_anew)


def _seen(beat: Beat, drive: str) -> Picture | None:
    """What the policy saw; None where it is no picture of its size."""
    if (view := beat.view) != FULL_VIEW:
        shown = (
            f"{view.horizontal_deg:g} x {view.vertical_deg:g}"
            if view
            else "it does not say how many"
        )
        raise ConfigurationError(
            f"the pictures of {drive} show {shown} degrees, and simulation trains with "
            f"{FULL_VIEW.horizontal_deg:g} x {FULL_VIEW.vertical_deg:g}: leave it out by "
            "`workstation drives drop`, and record by a policy that sees so much"
        )
    picture = observation(beat)
    return picture if picture is not None and picture.shape == _SHAPE else None


def _windows(
    stretch: Sequence[_Lived], length: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Pictures, wheels before and advice of sequences in which each of a hand's beats is once."""
    by_hand = [place for place, one in enumerate(stretch) if one.by_hand]
    done = 0
    for place in by_hand:
        if place < done:
            continue
        begin = max(0, min(place - round(WARM_UP * length), len(stretch) - length))
        done = begin + length
        pictures = np.zeros((length, *_SHAPE), np.uint8)
        told = np.zeros((length, ACTIONS), np.float32)
        advice = np.full((length, ACTIONS), np.nan, np.float32)
        for at, one in enumerate(stretch[begin:done]):
            pictures[at], told[at] = one.picture, one.told
            if one.by_hand and begin + at >= place:
                advice[at] = np.clip(one.wheels, -1, 1)
        yield pictures, told, advice
