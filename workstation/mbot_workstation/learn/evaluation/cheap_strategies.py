"""Drivers that look at nothing, and the task's own guide: what a reward must tell apart.

A reward that pays for one of the former more than for the guide is learned just so, after a night:
turning in circles, standing at the border, shuttling to and fro (docs/tasks.md).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_workstation.learn.drivers.contestants import Driver
from mbot_workstation.learn.drivers.onnx_policy import Actions
from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.body_record import BODY_RECORD, body_record
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.tasks.task import Task

WHEELS: Mapping[str, tuple[tuple[float, float], ...]] = {
    "standing": ((0.0, 0.0),),
    "spinning": ((0.5, -0.5),),
    "in circles": ((1.0, 0.6),),
    "full ahead": ((1.0, 1.0),),
    "backwards": ((-1.0, -1.0),),
    "to the border": (*[(1.0, 1.0)] * 15, *[(0.0, 0.0)] * 400),
    "to and fro": (*[(1.0, 1.0)] * 4, *[(-1.0, -1.0)] * 4),
}
"""Left and right wheel, decision by decision, again and again."""


def blind_driver(name: str, robots: int) -> Driver:
    """One of `WHEELS`, for so many robots."""
    wheels = np.array(WHEELS[name], np.float32)
    made = np.zeros(robots, np.int64)

    def act(_pictures: object, _infos: Sequence[Mapping[str, Any]]) -> Actions:
        told = wheels[made % len(wheels)]
        made[:] += 1
        return told

    def forget(ended: NDArray[np.bool_]) -> None:
        made[ended] = 0

    return Driver(act, forget)


def guide_driver(task: Task, robots: int, ranges: EffectRanges, remembers: int) -> Driver | None:
    """The task's guide at the wheels of so many usual robots; None if it has none.

    Where it has no advice, it stands.
    """
    nominal = RobotParameters()
    guide = task.guide(robots, ranges, nominal, remembers)
    if guide is None:
        return None
    usual = body_record(ranges.low, nominal)
    guide.become(np.array([usual] * robots, BODY_RECORD))
    names = task.facts.names or ()

    def act(_pictures: object, infos: Sequence[Mapping[str, Any]]) -> Actions:
        facts = np.array([tuple(info[name] for name in names) for info in infos], task.facts)
        advice = np.nan_to_num(guide.act(facts)).astype(np.float32)
        wheels = within_full_speed(torch.from_numpy(advice)).numpy()
        guide.drove(wheels)
        return wheels

    return Driver(act, guide.forget)
