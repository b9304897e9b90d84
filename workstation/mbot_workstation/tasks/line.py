"""Follow a line of black tape, three times around: curves, crossings and gaps."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.pose import Pose
from mbot_workstation.tasks.episode import NOTHING, Guide, Moment, Setting, Step
from mbot_workstation.tasks.fetch.episode import IN_VIEW_RAD, from_robot
from mbot_workstation.tasks.floor.aim_guide import AimGuide
from mbot_workstation.tasks.floor.tape import Tape, even, figure_eight, laid_from, round_line
from mbot_workstation.tasks.floor.taped import SLACK_S, TapedRun, TapedTask
from mbot_workstation.tasks.lesson import Lesson

LAP, WAY, LOST, TIME_OUT = "lap", "half a metre", "lost", "time-out"
LAP_SCORE, WAY_SCORE, LOST_SCORE = 1.0, 0.1, -1.0
WAY_M = 0.5

LOST_M = 0.15
"""A robot whose middle is so far from the line has lost it."""

AHEAD_M = 0.3
"""The guide drives to the line so far ahead."""

STEP_M = 0.02
"""Between the places of the line that are told apart."""

BACK_M, FORTH_M = 0.3, 0.5
"""How far along the line the nearest place is looked for: at a crossing it does not turn off."""

TURN_AWAY_RAD, BESIDE_M = math.radians(30), 0.10
"""How far from the line's heading, and from the line, pictures are taken to learn to see by."""

GAP_PIECES = (1, 2)
"""Of tape that are missing, 0.13 m each."""

FACTS = np.dtype(
    [
        ("laps", np.int32),
        ("time_left_s", np.float32),
        ("way_m", np.float32),
        ("beside_m", np.float32),
        ("aim_ahead_m", np.float32),
        ("aim_left_m", np.float32),
        ("seen_ahead_m", np.float32),
        ("seen_left_m", np.float32),
    ]
)
"""Laps so far; how long this one may still take; metres along the line since the start; how far the
line is; where it is 0.3 m further on, from the robot, and from where the picture was taken."""


@dataclass(frozen=True, slots=True)
class LineLesson(Lesson):
    """What lines there are.

    Attributes:
        laps: make a complete run.
        crossings: share of lines that cross themselves.
        gaps: how many there are, at most.
        lap_s: how long a lap may take.

    """

    laps: int = 3
    crossings: float = 0.0
    gaps: int = 0
    lap_s: float = 60.0

    @property
    def goal(self) -> int:
        """Laps."""
        return self.laps

    @property
    def largest_reward(self) -> float:
        """Of lines of 6 m."""
        return self.laps * (LAP_SCORE + WAY_SCORE * 6 / WAY_M)


class LineRun(TapedRun):
    """One run. It begins on the line, along it."""

    def __init__(self, lesson: LineLesson, rng: np.random.Generator) -> None:
        if rng.random() < lesson.crossings:
            line = figure_eight(rng, (0.9, 1.1))
        else:
            line = round_line(rng, (0.7, 1.1), 0.25)
        if rng.random() < 0.5:
            line = line[::-1]
        line = laid_from(line, int(rng.integers(len(line))))
        super().__init__(Tape(line))
        self._lesson = lesson
        for _ in range(int(rng.integers(lesson.gaps + 1))):
            first = int(rng.integers(3, len(line) - 3))
            gap = range(first, first + int(rng.integers(*GAP_PIECES, endpoint=True)))
            if not self.missing & {*range(first - 1, gap.stop + 1)}:  # none is longer
                self.missing |= {*gap}
        self._places = even(line, STEP_M)
        self._at = 0  # counts on from lap to lap
        self._furthest_m = self._lap_s = 0.0
        self._laps = 0

    def free_way_m(self, robot: Pose) -> float:
        """Until the line is lost."""
        return max(0.0, LOST_M - self._nearest(robot)[1])

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """Count the way along the line."""
        self._at, beside_m = self._nearest(robot)
        self._lap_s += elapsed_s
        if beside_m >= LOST_M:
            return self.happened(LOST, LOST_SCORE, ended=True)
        if self._lap_s >= self._lesson.lap_s - SLACK_S:
            return self.happened(TIME_OUT, LOST_SCORE, ended=True)
        if self._at >= (self._laps + 1) * len(self._places):
            self._laps += 1
            self._lap_s = 0.0
            return self.happened(LAP, LAP_SCORE, ended=self._laps >= self._lesson.laps)
        if self._at * STEP_M >= self._furthest_m + WAY_M:
            self._furthest_m += WAY_M
            return self.happened(WAY, WAY_SCORE, ended=False)
        return Step()

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """FACTS."""
        at, beside_m = self._nearest(moment.robot)
        return (
            self._laps,
            self._lesson.lap_s - self._lap_s,
            self._at * STEP_M,
            beside_m,
            *from_robot(moment.robot, self._place(at, AHEAD_M)),
            *from_robot(moment.seen_from, self._place(self._nearest(moment.seen_from)[0], AHEAD_M)),
        )

    def result(self) -> Mapping[str, Any]:
        """The run so far."""
        return {"laps": self._laps, "score": round(self._score, 4)}

    def anywhere(self, rng: np.random.Generator) -> Pose:
        """A pose by the line; the run goes on from there."""
        self._at = int(rng.integers(len(self._places)))
        here, further = self._place(self._at), self._place(self._at, 2 * STEP_M)
        heading = math.atan2(further.y_m - here.y_m, further.x_m - here.x_m)
        beside_m = rng.uniform(-BESIDE_M, BESIDE_M)
        return Pose(
            here.x_m - beside_m * math.sin(heading),
            here.y_m + beside_m * math.cos(heading),
            heading + rng.uniform(-TURN_AWAY_RAD, TURN_AWAY_RAD),
        )

    def _nearest(self, robot: Pose) -> tuple[int, float]:
        """Which place of the line, near the last one, and how far it is."""
        around = np.arange(self._at - round(BACK_M / STEP_M), self._at + round(FORTH_M / STEP_M))
        places = self._places[around % len(self._places)]
        away = np.hypot(places[:, 0] - robot.x_m, places[:, 1] - robot.y_m)
        nearest = int(away.argmin())
        return int(around[nearest]), float(away[nearest])

    def _place(self, at: int, further_m: float = 0.0) -> Pose:
        x_m, y_m = self._places[(at + round(further_m / STEP_M)) % len(self._places)].tolist()
        return Pose(x_m, y_m)


class LineSight:
    """See `Sight`."""

    def scatter(self, episode: LineRun, rng: np.random.Generator) -> Pose:
        """By the line, roughly along it."""
        return episode.anywhere(rng)

    def shown(self, facts: "np.ndarray[Any, np.dtype[np.void]]") -> NDArray[np.float32]:
        """Where the line is ahead."""
        ahead, left = facts["seen_ahead_m"], facts["seen_left_m"]
        is_shown = np.abs(np.arctan2(left, ahead)) < IN_VIEW_RAD
        return np.stack([is_shown, 6 * left, 6 * (ahead - AHEAD_M)], axis=1).astype(np.float32)

    def mirrored(self, shown: NDArray[np.float32]) -> NDArray[np.float32]:
        """On the other side."""
        return shown * np.array([1, -1, 1], np.float32)


class FollowLine(TapedTask):
    """Three laps."""

    name = "line"
    counted, counted_one, counted_done = "laps", "lap", "driven"
    happenings = (NOTHING, LAP, WAY, LOST, TIME_OUT)
    facts = FACTS
    critic: Mapping[str, float] = {
        "laps": 0.3,
        "time_left_s": 0.02,
        "beside_m": 5.0,
        "aim_left_m": 3.0,
        "aim_ahead_m": 3.0,
    }
    lessons = (
        LineLesson("curves", laps=1),
        LineLesson("3-laps", crossings=0.35, gaps=2),
    )
    sight = LineSight()

    def begin(self, lesson: LineLesson, setting: Setting, rng: np.random.Generator) -> LineRun:
        """Start a run on a line of its own."""
        del setting
        return LineRun(lesson, rng)

    def guide(
        self, robots: int, ranges: EffectRanges, robot: RobotParameters, remembers: int
    ) -> Guide:
        """To where the line is 0.3 m further on."""
        del remembers
        return AimGuide(robots, ranges, robot, lambda facts: np.ones(facts.shape, np.bool_))


TASK = FollowLine()
