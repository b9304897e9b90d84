"""What a replay found, in lines of at most 80 columns, as JSON, and as a strip of pictures."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import FieldOfView
from mbot_workstation.look.drives.replayed_drive import TOLERANCE, Redecided, Replay
from mbot_workstation.pictures.film_tile import Bar, Tile, strip_of
from mbot_workstation.pictures.picture_file import observation
from mbot_workstation.wording import one_line, short_digest

MOST_ROWS = 12
STRIP_TILES = 12
NOTABLE = 0.1
"""A twentieth of a wheel's range: below it a robot drives about the same way."""

COLUMNS = 6


def lines(found: Replay) -> Iterator[str]:
    """What a person wants to know, most important first."""
    yield from summary(found)
    if differing := rows(found, MOST_ROWS):
        yield ""
        yield "     time  beat      then              now               differs by"
        yield from (_row(one) for one in differing)


def rows(found: Replay, most: int) -> list[Redecided]:
    """The decisions that differ most and enough to be named, in the order of their making."""
    worth = 0.0 if found.same_model else NOTABLE
    return [one for one in worst(found.decisions, most) if one.difference > worth]


def summary(found: Replay) -> Iterator[str]:
    """How much differs, without the single decisions."""
    count, model = len(found.decisions), short_digest(found.model_sha256)
    yield f"{found.drive.name}: {count} decisions"
    if found.same_model:
        where = "the same kind of processor" if found.same_processor else "another processor"
        yield f"  again by the model that drove ({model}), on {where}"
        yield f"  {found.exact} are the same to the last bit, memory and motor bytes included"
        if found.exact < count:
            yield f"  {found.same_motor_bytes} would send the board the same bytes"
            yield (
                f"  the largest difference of an action is {found.largest_difference:.2g}, "
                f"{TOLERANCE:g} is allowed on another processor"
            )
    else:
        notable = [one for one in found.decisions if one.difference > NOTABLE]
        yield f"  had {one_line(found.model_name)[:40]} ({model}) been asked:"
        yield f"  {len(notable)} differ by more than {NOTABLE:g} in a wheel"
        finite = [one.difference for one in found.decisions if not one.failure]
        if finite:
            yield f"  half of all by less than {np.median(finite):.2g}"
        for who, ones in _drivers(found):
            mean = np.mean([one.apart for one in ones])
            yield f"  {len(ones):5d} beats by {who}: mean difference of a wheel {mean:.3f}"
    if failed := sum(bool(one.failure) for one in found.decisions):
        yield f"  {failed} end in a failure of the model"
    for views in found.other_views:
        yield from view_words(*views)
    by_hand = sum(beat.by_hand for beat in found.drive.beats)
    if by_hand and not any(one.beat.by_hand for one in found.decisions):
        yield f"  {by_hand} beats were driven by hand: no decision of a policy"
    if found.left_out:
        yield f"  {found.left_out} are left out: their picture is not in the recording"


def _drivers(found: Replay) -> Iterator[tuple[str, list[Redecided]]]:
    """Who drove, and when: a policy answers for a hand's beats too, if it is another one."""
    for who, by_hand in (("policy", False), ("hand", True)):
        if ones := [one for one in found.decisions if one.beat.by_hand == by_hand]:
            yield who, ones


def view_words(shown: FieldOfView | None, wanted: FieldOfView) -> Iterator[str]:
    """What a model wants to see, and what it was shown."""
    wants = f"  it wants to see {_degrees(wanted)}"
    if shown is None:
        yield f"{wants};"
        yield "  whether the pictures show that, this older recording does not say"
    else:
        yield f"{wants}, the pictures show {_degrees(shown)}:"
        yield "  it would have seen others, so what differs here says little"


def _degrees(view: FieldOfView) -> str:
    return f"{view.horizontal_deg:g} x {view.vertical_deg:g} degrees"


def _row(one: Redecided) -> str:
    time, beat, then, now, differs = cells(one)
    return f"{time:>9s}  {beat:<8s}{then}   {now[:40]}   {differs}".rstrip()


def cells(one: Redecided) -> tuple[str, str, str, str, str]:
    """One decision in words: time, beat, wheels then and now (or why none), difference."""
    failed = bool(one.failure)
    return (
        f"{one.since_s:.1f} s",
        str(one.beat.decision.sequence),
        _wheels(one.action_then),
        one_line(one.failure) if failed else _wheels(one.action),
        "" if failed else f"{one.difference:.2g}{' by hand' if one.beat.by_hand else ''}",
    )


def _wheels(action: tuple[float, float]) -> str:
    return f"{action[0]:+.3f} {action[1]:+.3f}"


def worst(decisions: Sequence[Redecided], most: int) -> list[Redecided]:
    """The decisions that differ most, in the order in which they were made."""
    chosen = sorted(decisions, key=lambda one: -one.difference)[:most]
    return sorted(chosen, key=lambda one: one.since_s)


class OtherView(Struct, frozen=True):
    """What recorded pictures show, None if nobody knows, and what the model wants to see."""

    shown_deg: list[float] | None
    wanted_deg: list[float] | None


class DifferentDecision(Struct, frozen=True):
    """One that was decided otherwise; None: not a finite number, or no failure."""

    sequence: int
    since_s: float
    then: tuple[float, float]
    now: tuple[float, float]
    difference: float | None
    failure: str | None
    by_hand: bool


class ReplayAnswer(Struct, frozen=True):
    """What a replay found, for programs."""

    recording: str
    model_sha256: str
    same_model: bool
    same_processor: bool
    decisions: int
    exact: int
    same_motor_bytes: int
    largest_difference: float | None
    mean_difference: dict[str, float]
    left_out: int
    other_views: list[OtherView]
    as_expected: bool
    differing: list[DifferentDecision]


def replay_answer(found: Replay) -> ReplayAnswer:
    """For programs."""
    return ReplayAnswer(
        recording=found.drive.name,
        model_sha256=found.model_sha256,
        same_model=found.same_model,
        same_processor=found.same_processor,
        decisions=len(found.decisions),
        exact=found.exact,
        same_motor_bytes=found.same_motor_bytes,
        largest_difference=_finite(found.largest_difference),
        mean_difference={
            who: float(np.mean([one.apart for one in ones])) for who, ones in _drivers(found)
        },
        left_out=found.left_out,
        other_views=[OtherView(_pair(one), _pair(other)) for one, other in found.other_views],
        as_expected=found.is_as_expected,
        differing=[_different(one) for one in found.decisions if not one.is_exact],
    )


def _different(one: Redecided) -> DifferentDecision:
    number, since_s = one.beat.decision.sequence, round(one.since_s, 3)
    difference, failure, hand = _finite(one.difference), one.failure or None, one.beat.by_hand
    return DifferentDecision(
        number, since_s, one.action_then, one.action, difference, failure, hand
    )


def _pair(view: FieldOfView | None) -> list[float] | None:
    return [view.horizontal_deg, view.vertical_deg] if view is not None else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def strip(found: Replay) -> Picture:
    """The decisions that differ most: what was seen, both wheels then (L, R) and now (l, r)."""
    tiles: list[Tile] = []
    for one in worst(found.decisions, STRIP_TILES):
        picture = observation(one.beat)
        if picture is not None:
            shares = zip("LRlr", (*one.action_then, *one.action), strict=True)
            bars = tuple(Bar(name, share) for name, share in shares)
            tiles.append(Tile(picture, f"{one.since_s:.1f} s", bars))
    title = f"{found.drive.name}: L, R as driven; l, r by {one_line(found.model_name)[:30]}"
    return strip_of(tiles, COLUMNS, title)
