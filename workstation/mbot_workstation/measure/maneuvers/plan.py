"""Which maneuver is driven when."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from mbot_workstation.measure.tracks.maneuver import Maneuver

FULL_SPEED_MPS = 0.41
"""120 rpm on wheels of 32.5 mm (paper, derived)."""

OUTER_REACH_M = 0.15
"""From the axle's centre to the robot's farthest corner, with a tracker or marker on it."""

SPREAD = 1.3
"""Of a real robot's path against the nominal one: motors differ, circles drift."""

TURNED_FROM = {"forward": "backward", "backward": "forward", "neutral": "neutral"}


class Order(Enum):
    """How one round of all maneuvers is ordered."""

    PAIRED = "paired"
    """Each maneuver is followed by its opposite, so the robot comes back by itself."""
    LISTED = "listed"
    SHUFFLED = "shuffled"


@dataclass(frozen=True, slots=True)
class Planned:
    """One run to drive. `repetition` counts from 1."""

    maneuver: Maneuver
    repetition: int


def plan(
    maneuvers: Sequence[Maneuver], repetitions: int, order: Order, seed: int = 0
) -> tuple[Planned, ...]:
    """All runs, in rounds: every maneuver once, then every one again.

    Rounds spread a battery's decline over all maneuvers alike.
    """
    chance = random.Random(seed)
    runs: list[Planned] = []
    for repetition in range(1, repetitions + 1):
        one_round = list(maneuvers)
        if order is Order.PAIRED:
            one_round = _paired(maneuvers)
        elif order is Order.SHUFFLED:
            chance.shuffle(one_round)
        runs += [Planned(maneuver, repetition) for maneuver in one_round]
    return tuple(runs)


def room_needed_m(maneuver: Maneuver, seconds: float) -> tuple[float, float]:
    """Free floor for one run: length along the robot's start heading, width across it.

    Straight runs need their whole way, turning ones the circle they turn in. Generous.
    """
    from mbot_workstation.sim.body.robot_parameters import RobotParameters  # numpy: `--help` waits

    robot_m = 2 * OUTER_REACH_M
    if maneuver.is_slow:  # about either wheel in turn
        return 2 * robot_m, 2 * robot_m
    if maneuver.left == maneuver.right:
        way_m = FULL_SPEED_MPS * seconds
        return way_m * 1.1 + robot_m, way_m * 0.5 + robot_m
    forward = abs(maneuver.left + maneuver.right) / 2
    turn = abs(maneuver.right - maneuver.left) / RobotParameters().track_m
    circle_m = 2 * forward / turn * SPREAD + robot_m
    return circle_m, circle_m


@dataclass(frozen=True, slots=True)
class Reach:
    """How far runs go from where they start, in metres, to each side of the robot."""

    ahead_m: float
    behind_m: float
    left_m: float
    right_m: float


def reach(maneuvers: Sequence[Maneuver], seconds: float) -> Reach:
    """The free floor that all of them need together, each begun at the same place."""
    ahead = behind = left = right = 2 * OUTER_REACH_M
    for maneuver in maneuvers:
        length_m, width_m = room_needed_m(maneuver, seconds)
        if maneuver.left == maneuver.right and not maneuver.is_slow:
            ahead = max(ahead, length_m) if maneuver.left > 0 else ahead
            behind = max(behind, length_m) if maneuver.left < 0 else behind
            left, right = max(left, width_m / 2), max(right, width_m / 2)
            continue
        # About the slower wheel: the circle lies on its side, half of it behind.
        ahead, behind = max(ahead, length_m / 2), max(behind, length_m / 2)
        turns_about_left = abs(maneuver.left) <= abs(maneuver.right)
        left = max(left, width_m) if turns_about_left else left
        right = max(right, width_m) if not turns_about_left else right
    return Reach(round(ahead, 1), round(behind, 1), round(left, 1), round(right, 1))


def duration_words(seconds: float) -> str:
    """Such as "45 s", "18 min"."""
    return f"{seconds:.0f} s" if seconds < 90 else f"{math.ceil(seconds / 60)} min"


def announcement(left: Sequence[Planned], seconds: float, pause_s: float) -> str:
    """What is about to be driven, how long it takes and which floor it needs."""
    if not left:
        return "everything is recorded already"
    each_s = [one.maneuver.duration_s(seconds) for one in left]
    in_all_s = sum(each_s) + len(left) * (pause_s + 0.5)
    floor = reach([one.maneuver for one in left], seconds)
    return (
        f"{len(left)} runs of {max(each_s):g} s, about {duration_words(in_all_s)}; free floor from "
        f"where the robot starts: {floor.ahead_m:g} m ahead, {floor.behind_m:g} m behind, "
        f"{floor.left_m:g} m to its left, {floor.right_m:g} m to its right"
    )


def _paired(maneuvers: Sequence[Maneuver]) -> list[Maneuver]:
    left = list(maneuvers)
    ordered: list[Maneuver] = []
    while left:
        first = left.pop(0)
        ordered.append(first)
        opposite = "-".join(TURNED_FROM.get(side, side) for side in first.name.split("-"))
        partner = next((other for other in left if other.name == opposite), None)
        if partner is not None:
            left.remove(partner)
            ordered.append(partner)
    return ordered
