"""A task of your own, to begin with: touch objects, one after the other, and be paid on the way.

    workstation task check FILE.py
    workstation train --name mine --task FILE.py
    workstation evaluate --task FILE.py MODEL.onnx

It is the paper's task, which pays 1 to 2 for an object, -1 for border and time-out and 1 at the
end, with other rewards besides; docs/tasks.md has what can be changed, and which rewards fail.
"""

from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.paid import PaidFetch, Situation


def approach(now: Situation) -> float:
    """Pays for coming nearer and takes as much for going away, or to and fro would be paid."""
    return 0.2 * now.nearer_m


def haste(now: Situation) -> float:
    """Costs for every second, or standing would be as good as driving."""
    return -0.01 * now.elapsed_s


class NewTask(PaidFetch):
    """One object nearby, then ten everywhere, each within the paper's 66.8 s."""

    name = "new-task"
    lessons = (FetchLesson("near", 1.0), FetchLesson("far", 2.5, objects=10))
    rewards = (approach, haste)


TASK = NewTask()
