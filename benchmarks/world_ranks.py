"""Which world of ours tells what a policy is worth elsewhere: ranks of checkpoints, world by world.

    python benchmarks/world_ranks.py CHECKPOINTS --pictures ../shared/photoreal ../shared/pictures

CHECKPOINTS is a folder of a run's checkpoints, early ones too (a run keeps its last only: copy
them while it learns). Each drives in our worlds and judges the labelled pictures. What a set of
pictures says is the mean of the shares that it got right: turned the right way, went ahead, did
not drive on at nothing. Printed are, of each pair, Pearson's correlation and the mean maximum rank
violation (SIMPLER, arXiv 2405.05941): by how much the pictures' share is worse, in the worst case,
if the world is believed about which of two is better. 0 is best.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.policy.policy_contract import FULL_VIEW, PolicyMetadata
from mbot_workstation.learn.drivers.contestants import Driver
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy
from mbot_workstation.learn.evaluation.episodes import Trial, evaluate_driver, score
from mbot_workstation.learn.evaluation.labelled_pictures import (
    PLAIN_KINDS,
    LabelledPicture,
    judge,
    observations,
    read_labelled,
)
from mbot_workstation.learn.learning.checkpoint import read_weights
from mbot_workstation.learn.learning.policy_graph import policy_graph
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.tasks.find import find_task
from mbot_workstation.tasks.lesson import lesson_named

WORLDS = ("ideal", "nominal", "randomised", "any-room", "home")

Values = NDArray[np.float64]


def pearson(one: Values, other: Values) -> float:
    """Of two worlds' figures of the same policies; NaN if one world tells none apart."""
    if one.std() == 0 or other.std() == 0:
        return float("nan")
    return float(np.corrcoef(one, other)[0, 1])


def mean_maximum_rank_violation(ours: Values, theirs: Values) -> float:
    """How much is lost, in theirs, by believing ours about which is better; shapes (n,)."""
    apart = np.abs(theirs[:, None] - theirs[None])
    swapped = (ours[:, None] < ours[None]) != (theirs[:, None] < theirs[None])
    return float((apart * swapped).max(axis=1).mean())


def share_right(driver: OnnxPolicy, pictures: Sequence[LabelledPicture]) -> float:
    """Of a set's pictures, kind by kind."""
    driver.forget(np.ones(len(pictures), np.bool_))
    actions = driver.act(observations(pictures, None, FULL_VIEW))
    told = judge(actions, pictures)
    kinds = [told[name] for name in PLAIN_KINDS if told[name].total]
    return float(np.mean([1 - len(kind.names) / kind.total for kind in kinds]))


def rewards(policy: OnnxPolicy, episodes: int) -> dict[str, float]:
    """Its mean reward in each of our worlds, in rooms that training never shows."""
    rooms = evaluation_rooms([])
    lesson = lesson_named(find_task().lessons, "10")
    driver = Driver(lambda pictures, _infos: policy.act(pictures), policy.forget)
    told: dict[str, float] = {}
    for name in WORLDS:
        trial = Trial(lesson, preset(name), rooms, episodes, seed=11)
        told[name] = score(evaluate_driver(driver, trial)).reward.mean
    return told


def ranks(rows: Sequence[Mapping[str, float]], sets: Sequence[str]) -> list[str]:
    """A table, a line a world."""
    head = " | ".join(f"{name}: Pearson, violation" for name in sets)
    lines = [f"| world | {head} |", "|---" * (len(sets) + 1) + "|"]
    for world in WORLDS:
        ours = np.array([row[world] for row in rows])
        cells: list[str] = []
        for name in sets:
            theirs = np.array([row[name] for row in rows])
            violation = mean_maximum_rank_violation(ours, theirs)
            cells.append(f"{pearson(ours, theirs):.2f}, {violation:.3f}")
        lines.append(f"| {world} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("checkpoints", type=Path)
    parser.add_argument("--pictures", type=Path, nargs="+", required=True)
    parser.add_argument("--episodes", type=int, default=32)
    options = parser.parse_args()
    sets = {folder.name: read_labelled(folder) for folder in options.pictures}
    rows: list[dict[str, float]] = []
    for checkpoint in sorted(path for path in options.checkpoints.iterdir() if path.is_dir()):
        graph = policy_graph(read_weights(checkpoint), PolicyMetadata(checkpoint.name))
        policy = OnnxPolicy(graph.SerializeToString())
        row = {name: share_right(policy, pictures) for name, pictures in sets.items()}
        row |= rewards(policy, options.episodes)
        rows.append(row)
        print(json.dumps({"checkpoint": checkpoint.name, **row}), flush=True)
    print("\n".join(ranks(rows, list(sets))))


if __name__ == "__main__":
    main()
