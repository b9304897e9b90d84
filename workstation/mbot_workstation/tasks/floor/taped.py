"""What tasks with nothing but a closed line of tape on the floor have in common."""

from collections.abc import Mapping

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.tasks.episode import Step
from mbot_workstation.tasks.floor.aim_guide import aim_expert
from mbot_workstation.tasks.floor.tape import Tape
from mbot_workstation.tasks.task import Expert, Task

SLACK_S = 0.0025
"""Half a physics step: a sum of many small steps is not exact."""


class TapedRun:
    """One run.

    Attributes:
        tape: what is laid.
        missing: pieces of it that are not.
        ended: whether the run is over.

    """

    def __init__(self, tape: Tape) -> None:
        self.tape, self.missing, self.ended = tape, frozenset[int](), False
        self._score = 0.0

    def places(self) -> Mapping[int, Pose]:
        """Nothing stands here."""
        return {}

    def happened(self, what: str, score: float, *, ended: bool) -> Step:
        """Count it."""
        self._score += score
        self.ended = ended
        return Step(what, score, ended)


class TapedTask(Task):
    """Its facts name where it would be good to go next, `aim_ahead_m` and `aim_left_m`."""

    def pieces(self, episode: TapedRun) -> tuple[Distractor, ...]:
        """The tape, but for its gaps."""
        pieces = episode.tape.pieces()
        return tuple(one for number, one in enumerate(pieces) if number not in episode.missing)

    def expert(self, robots: int, ranges: EffectRanges, robot: RobotParameters) -> Expert:
        """As its guide, whatever pictures show."""
        return aim_expert(robots, ranges, robot)
