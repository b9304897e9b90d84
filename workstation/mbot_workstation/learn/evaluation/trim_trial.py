"""Whether a policy does better on uneven motors that the daemon trims, or on what they are."""

from dataclasses import dataclass

import msgspec

from mbot_workstation.learn.drivers.contestants import title
from mbot_workstation.learn.evaluation.episodes import Estimate, Trial, evaluate, score
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration
from mbot_workstation.tasks.find import find_task
from mbot_workstation.tasks.lesson import lesson_named

EPISODES = 32
"""Each way, the same rooms and objects for both."""


@dataclass(frozen=True, slots=True)
class TrimTrial:
    """What a policy got, simulated, on the last lesson of the course.

    Attributes:
        policy: its name.
        episodes: each way.
        trimmed, alone: mean reward with the trim that drives straight, and without.
        chosen: "trimmed" or "alone": what drives straight also drives slower, so that a tie goes
            to the policy's own way.

    """

    policy: str
    episodes: int
    trimmed: Estimate
    alone: Estimate
    chosen: str

    def line(self) -> str:
        """For people."""
        ways = (("trimmed", self.trimmed), ("left alone", self.alone))
        told = ", ".join(f"{way} {x.mean:.2f} ({x.low:.2f} to {x.high:.2f})" for way, x in ways)
        return (
            f"{self.policy} on this robot, simulated, {self.episodes} episodes each (21 is all): "
            f"{told}; {'trimmed' if self.chosen == 'trimmed' else 'left alone'} is written"
        )


def try_trim(
    policy: str,
    files: CalibrationFiles,
    trimmed: MotionCalibration,
    alone: MotionCalibration,
    episodes: int = EPISODES,
) -> TrimTrial:
    """Drive the identified robot both ways.

    Args:
        policy: a file, or another contestant of `workstation evaluate`.
        files: what is known of the robot besides.
        trimmed, alone: its motion, with both sets of motor maps.
        episodes: each way.

    Raises:
        MbotError: the policy is none.

    """
    task = find_task()
    lesson = lesson_named(task.lessons, task.course(guided=False, further=False)[-1])
    rooms = evaluation_rooms(())
    rewards: list[Estimate] = []
    for motion in (trimmed, alone):
        known = msgspec.structs.replace(files, motion=motion)
        trial = Trial(
            lesson,
            known.ranges("nominal"),
            rooms,
            episodes,
            robot=known.robot,
            scene=known.scene,
        )
        rewards.append(score(evaluate(policy, trial)).reward)
    straight, own_way = rewards
    chosen = "trimmed" if straight.mean > own_way.mean else "alone"
    return TrimTrial(title(policy), episodes, straight, own_way, chosen)
