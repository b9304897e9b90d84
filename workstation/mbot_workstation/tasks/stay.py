"""Stay inside a taped area, and drive there: a minute, without a wheel on the tape."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.episode import NOTHING, Guide, Moment, Setting, Step
from mbot_workstation.tasks.floor.aim_guide import AimGuide
from mbot_workstation.tasks.floor.tape import Tape, round_line
from mbot_workstation.tasks.floor.taped import SLACK_S, TapedRun, TapedTask
from mbot_workstation.tasks.lesson import Lesson

LEFT, DONE, NEW_PLACE = "left", "done", "new place"
LEFT_SCORE, DONE_SCORE, NEW_PLACE_SCORE = -1.0, 1.0, 0.1

PLACE_M, FORGOTTEN_S = 0.4, 10.0
"""Squares of floor; one that was left this long ago is new again. Paid by the metre, a robot
would turn in circles."""

WHEEL_M = 0.075
"""From the axle's middle to the outside of a wheel."""

TURNS_AT_M = 0.5
"""The guide turns where so little way is left ahead: what it drives in a decision, and one more for
pictures that are late."""

LOOKS_M = 2.0
"""What is further away is not told apart."""

TURN_RAD = math.radians(110)
"""How far it then turns, to the left: who chooses a side each time turns to and fro in corners."""

FACTS = np.dtype(
    [
        ("seconds", np.int32),
        ("time_left_s", np.float32),
        ("to_tape_m", np.float32),
        ("way_ahead_m", np.float32),
        ("seen_way_m", np.float32),
        ("seen_left_way_m", np.float32),
        ("seen_right_way_m", np.float32),
        ("aim_ahead_m", np.float32),
        ("aim_left_m", np.float32),
    ]
)
"""For how long it has stayed inside; how long it is to; how far the tape is from its middle, and
straight ahead; likewise from where the picture was taken, and 20 degrees to the left and right of
there; where it would be good to go next."""

SIDE_RAD = math.radians(20)

SEEN_M = 0.6
"""Further away tape is less than a third of a pixel high."""


@dataclass(frozen=True, slots=True)
class StayLesson(Lesson):
    """How large the area is, and for how long the robot must drive.

    Attributes:
        radius_m: between these two.
        dents: see `round_line`.
        stay_s: for how long.

    """

    radius_m: tuple[float, float]
    dents: float
    stay_s: float

    @property
    def goal(self) -> int:
        """Seconds."""
        return round(self.stay_s)

    @property
    def largest_reward(self) -> float:
        """Of a robot that enters a new square every second; the guide does where there is room."""
        return DONE_SCORE + NEW_PLACE_SCORE * self.stay_s


class StayRun(TapedRun):
    """One run."""

    def __init__(self, lesson: StayLesson, rng: np.random.Generator) -> None:
        points = round_line(rng, lesson.radius_m, lesson.dents)
        turn = rng.uniform(-math.pi, math.pi)
        cos, sin = math.cos(turn), math.sin(turn)
        super().__init__(Tape(points @ np.array([[cos, sin], [-sin, cos]])))
        self._stay_s, self._now_s = lesson.stay_s, 0.0
        self._entered_s = {_square(ORIGIN): 0.0}

    def free_way_m(self, robot: Pose) -> float:
        """Until a wheel is on the tape."""
        return max(0.0, self.tape.away_m(robot.x_m, robot.y_m) - WHEEL_M)

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """See whether it has left, is done, or comes to another place."""
        self._now_s += elapsed_s
        if self.free_way_m(robot) == 0 or not self.tape.encloses(robot.x_m, robot.y_m):
            return self.happened(LEFT, LEFT_SCORE, ended=True)
        if self._now_s >= self._stay_s - SLACK_S:
            return self.happened(DONE, DONE_SCORE, ended=True)
        square = _square(robot)
        is_new = self._now_s - self._entered_s.get(square, -math.inf) > FORGOTTEN_S
        self._entered_s[square] = self._now_s
        return self.happened(NEW_PLACE, NEW_PLACE_SCORE, ended=False) if is_new else Step()

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """FACTS."""
        seen, robot = moment.seen_from, moment.robot
        ways = [
            min(self.tape.way_m(Pose(seen.x_m, seen.y_m, seen.yaw_rad + side)), LOOKS_M)
            for side in (0.0, SIDE_RAD, -SIDE_RAD)
        ]
        ahead_m = min(self.tape.way_m(robot), LOOKS_M)
        aim_rad = TURN_RAD if ahead_m < TURNS_AT_M else 0.0
        return (
            int(self._now_s),
            self._stay_s - self._now_s,
            self.tape.away_m(robot.x_m, robot.y_m),
            ahead_m,
            *ways,
            math.cos(aim_rad),
            math.sin(aim_rad),
        )

    def result(self) -> Mapping[str, Any]:
        """The run so far."""
        return {"seconds": int(self._now_s), "score": round(self._score, 4)}


class StaySight:
    """See `Sight`."""

    def scatter(self, episode: StayRun, rng: np.random.Generator) -> Pose:
        """Anywhere inside, in any direction."""
        reach_m = float(np.abs(episode.tape.points).max())
        while True:
            x_m, y_m = rng.uniform(-reach_m, reach_m, 2).tolist()
            pose = Pose(x_m, y_m, rng.uniform(-math.pi, math.pi))
            if episode.tape.encloses(x_m, y_m) and episode.free_way_m(pose) > 0:
                return pose

    def shown(self, facts: "np.ndarray[Any, np.dtype[np.void]]") -> NDArray[np.float32]:
        """Whether the tape is near, and how near, ahead and to either side."""
        ways = [facts[name] for name in ("seen_way_m", "seen_left_way_m", "seen_right_way_m")]
        near = np.minimum.reduce(ways) < SEEN_M
        return np.stack([near, *(0.3 / (0.1 + way) for way in ways)], axis=1).astype(np.float32)

    def mirrored(self, shown: NDArray[np.float32]) -> NDArray[np.float32]:
        """Left is right."""
        return shown[:, [0, 1, 3, 2]]


class Stay(TapedTask):
    """Drive, and stay inside."""

    name = "stay"
    counted, counted_one, counted_done = "seconds", "second", "stayed"
    happenings = (NOTHING, LEFT, DONE, NEW_PLACE)
    facts = FACTS
    critic: Mapping[str, float] = {
        "time_left_s": 0.02,
        "to_tape_m": 1.0,
        "way_ahead_m": 0.5,
        "seen_way_m": 0.5,
    }
    lessons = (
        StayLesson("wide", (1.1, 1.4), 0.1, 30.0),
        StayLesson("60-s", (0.8, 1.4), 0.2, 60.0),
    )
    sight = StaySight()

    def begin(self, lesson: StayLesson, setting: Setting, rng: np.random.Generator) -> StayRun:
        """Start a run in the middle."""
        del setting
        return StayRun(lesson, rng)

    def guide(
        self, robots: int, ranges: EffectRanges, robot: RobotParameters, remembers: int
    ) -> Guide:
        """Straight on, and to the left where the tape is near."""
        del remembers
        # It turns left whatever the picture looks like mirrored.
        return AimGuide(robots, ranges, robot, lambda facts: np.zeros(facts.shape, np.bool_))

    def summary(self, result: Mapping[str, Any]) -> str:
        """For people."""
        return f"stayed inside for {result['seconds']} s; score {result['score']:.2f}"


def _square(place: Pose) -> tuple[int, int]:
    """The robot begins in the middle of one."""
    return math.floor(place.x_m / PLACE_M + 0.5), math.floor(place.y_m / PLACE_M + 0.5)


TASK = Stay()
