"""A task of one's own: fetch, but every turn costs. What do three ways of driving earn in it?"""

from mbot.sim import make_env
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.paid import PaidFetch, Situation


def calm(now: Situation) -> float:
    return -0.005 * abs(now.turned_rad)


class CalmFetch(PaidFetch):
    name, lessons, rewards = "calm-fetch", (FetchLesson("near", 1.0),), (calm,)

    def course(self, *, guided: bool, further: bool) -> tuple[str, ...]:
        return ("near",)


TASK = CalmFetch()

if __name__ == "__main__":  # `workstation task check` and `train --task` read this file, too
    env = make_env(task=__file__)
    for wheels in ((0.0, 0.0), (0.5, -0.5), (1.0, 1.0)):  # standing, spinning, full ahead
        _, facts = env.reset(seed=1)
        total, ended = 0.0, False
        while not ended:
            _, reward, ended, _, facts = env.step(wheels)
            total += float(reward)
        print(f"wheels {wheels}: earns {total:+.2f}, turning has cost {-facts['calm']:.2f}")
