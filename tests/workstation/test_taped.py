"""What tasks with a line of tape share."""

import numpy as np
import pytest

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.presets import NOMINAL
from mbot_workstation.tasks.episode import Step
from mbot_workstation.tasks.floor.tape import Tape
from mbot_workstation.tasks.floor.taped import TapedRun, TapedTask
from mbot_workstation.tasks.line import TASK as LINE
from mbot_workstation.tasks.stay import TASK as STAY

SQUARE = Tape(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]))


def test_what_happened_is_counted_and_may_end_the_run() -> None:
    run = TapedRun(SQUARE)
    assert run.happened("way", 0.25, ended=False) == Step("way", 0.25)
    assert not run.ended
    assert run.happened("lost", -1.0, ended=True) == Step("lost", -1.0, ended=True)
    assert run.ended
    assert run.places() == {}


@pytest.mark.parametrize("task", [LINE, STAY])
def test_the_tape_is_laid_but_for_its_gaps(task: TapedTask) -> None:
    run = TapedRun(SQUARE)
    whole = task.pieces(run)
    assert whole == SQUARE.pieces()
    run.missing = frozenset({1})
    assert task.pieces(run) == (whole[0], *whole[2:])


@pytest.mark.parametrize("task", [LINE, STAY])
def test_its_expert_drives_to_what_the_facts_name(task: TapedTask) -> None:
    drive = task.expert(3, NOMINAL, RobotParameters())
    places = ((0.5, 0.0), (0.3, 0.3), (0.3, -0.3))
    wheels = drive([{"aim_ahead_m": ahead, "aim_left_m": left} for ahead, left in places])
    turns = (wheels[:, 1] - wheels[:, 0]).tolist()
    assert turns[2] < -0.2 < turns[0] < 0.2 < turns[1]
