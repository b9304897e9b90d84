"""What of a run becomes its policy: the best in rooms that training never shows.

The last checkpoint is not always it: what an update does to a trained policy is partly luck. The
mean of the last ones has less of it.
"""

import threading
from dataclasses import asdict, astuple
from functools import partial
from pathlib import Path

from mbot_protocol.policy_contract import PolicyMetadata
from mbot_workstation.training.drivers.contestants import Driver
from mbot_workstation.training.drivers.onnx_policy import OnnxPolicy
from mbot_workstation.training.evaluation.episodes import Score, Trial, evaluate_driver, score
from mbot_workstation.training.learning.checkpoint import read_weights, write_average
from mbot_workstation.training.learning.policy_graph import policy_graph
from mbot_workstation.training.learning.policy_source import Choice, noted_choice
from mbot_workstation.training.learning.progress_display import Display
from mbot_workstation.training.learning.run_directory import (
    RunDirectory,
    first_candidate,
    write_json,
)
from mbot_workstation.training.learning.training_config import TrainingConfig
from mbot_workstation.training.worlds.rooms import CHOICE_ROOMS, gather_rooms

ROOMS = 6
EPISODES = 96
"""For each candidate, the same robots and rooms for all."""


def choose_checkpoint(
    run: RunDirectory, config: TrainingConfig, display: Display, stop: threading.Event
) -> None:
    """Try a finished run's last checkpoints and their average, and note the best in its folder.

    Nothing is chosen where there is nothing to choose from, or when someone says stop meanwhile.
    """
    last = run.last_checkpoint()
    candidates = [
        checkpoint
        for checkpoint in run.checkpoints()
        if int(checkpoint.name) >= first_candidate(int(last.name))
    ]
    noted = noted_choice(run)
    known = set(noted.tried) if noted else set[str]()
    names = {checkpoint.name for checkpoint in (*candidates, run.average)}
    if len(candidates) < 2 or known == names:
        return
    candidates.append(run.add_average(partial(write_average, checkpoints=tuple(candidates))))
    trial = Trial(
        config.stages()[-1],
        config.ranges(),
        gather_rooms([], ROOMS, CHOICE_ROOMS),
        EPISODES,
        seed=CHOICE_ROOMS + config.seed,
        workers=config.workers,
        robot=config.robot,
        scene=config.scene,
    )
    scores: dict[str, Score] = {}
    for number, checkpoint in enumerate(candidates, 1):
        if stop.is_set():
            return
        display.say(f"trying {number} of {len(candidates)}: {checkpoint.name}")
        scores[checkpoint.name] = _tried(checkpoint, trial)
    best = max(scores, key=lambda name: scores[name].reward.mean)
    display.say(f"{best} is the policy: mean reward {scores[best].reward.mean:.2f}")
    choice = Choice(best, {name: astuple(one.reward) for name, one in scores.items()}, EPISODES)
    write_json(run.choice_file, asdict(choice))


def _tried(checkpoint: Path, trial: Trial) -> Score:
    graph = policy_graph(read_weights(checkpoint), PolicyMetadata(checkpoint.name))
    policy = OnnxPolicy(graph.SerializeToString())
    driver = Driver(lambda pictures, _targets: policy.act(pictures), policy.forget)
    return score(evaluate_driver(driver, trial))
