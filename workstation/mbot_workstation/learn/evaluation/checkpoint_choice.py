"""What of a run becomes its policy: the best in rooms that training never shows.

The last checkpoint is not always it: what an update does to a trained policy is partly luck. The
mean of the last ones has less of it. The first few by a short trial meet in a longer one: they
differ by single episodes that go wrong, and the first of ten in a short trial was also lucky.
"""

import threading
from collections.abc import Sequence
from dataclasses import asdict, astuple, replace
from functools import partial
from pathlib import Path

from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_workstation.learn.drivers.contestants import Driver
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy
from mbot_workstation.learn.evaluation.episodes import Score, Trial, evaluate_driver, score
from mbot_workstation.learn.learning.checkpoint import read_weights, write_average
from mbot_workstation.learn.learning.policy_graph import policy_graph
from mbot_workstation.learn.learning.policy_source import Choice, Rewards, noted_choice
from mbot_workstation.learn.learning.progress_display import Display
from mbot_workstation.learn.learning.run_directory import (
    RunDirectory,
    first_candidate,
    write_json,
)
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.worlds.rooms import CHOICE_ROOMS, gather_rooms

ROOMS = 6
EPISODES = 96
"""For each candidate, the same robots and rooms for all."""

FINALISTS = 3
FINAL_EPISODES = 288
"""Of other robots, again the same for all. Five minutes on two cores."""


def choose_checkpoint(
    run: RunDirectory, config: TrainingConfig, display: Display, stop: threading.Event
) -> None:
    """Try a finished run's last checkpoints and their average, and note the best in its folder.

    Nothing is chosen where there is nothing to choose from, or when someone says stop meanwhile.
    What was found out before is not tried again.
    """
    if not is_undecided(run):
        return
    noted, trial = _noted(run), _trial(config)
    if noted is None:
        candidates = tuple(_candidates(run))
        average = run.add_average(partial(write_average, checkpoints=candidates))
        tried = _round([*candidates, average], trial, display, stop)
        if tried is None:
            return
        noted = Choice(_best_first(tried)[0], tried, EPISODES)
        write_json(run.choice_file, asdict(noted))
    names = _best_first(noted.tried)[:FINALISTS]
    finalists = [one for one in (*_candidates(run), run.average) if one.name in names]
    other = replace(trial, episodes=FINAL_EPISODES, seed=trial.seed + 1)
    finals = _round(finalists, other, display, stop)
    if finals is None:
        return
    best = _best_first(finals)[0]
    noted = replace(noted, chosen=best, finals=finals, final_episodes=FINAL_EPISODES)
    write_json(run.choice_file, asdict(noted))
    display.say(f"{best} is the policy: mean reward {finals[best][0]:.2f}")


def is_undecided(run: RunDirectory) -> bool:
    """Whether there is something to choose from, and no choice yet."""
    noted = _noted(run)
    return len(_candidates(run)) > 1 and not (noted and noted.finals)


def _candidates(run: RunDirectory) -> list[Path]:
    first = first_candidate(int(run.last_checkpoint().name))
    return [checkpoint for checkpoint in run.checkpoints() if int(checkpoint.name) >= first]


def _noted(run: RunDirectory) -> Choice | None:
    """What was found out about these very candidates."""
    noted = noted_choice(run)
    names = {checkpoint.name for checkpoint in (*_candidates(run), run.average)}
    return noted if noted and set(noted.tried) == names else None


def _trial(config: TrainingConfig) -> Trial:
    """The last lesson, in rooms that training never shows."""
    return Trial(
        config.stages()[-1],
        config.ranges(),
        gather_rooms([], ROOMS, CHOICE_ROOMS),
        EPISODES,
        seed=CHOICE_ROOMS + config.seed,
        workers=config.workers,
        robot=config.robot,
        scene=config.scene,
        task=config.task,
    )


def _round(
    candidates: Sequence[Path], trial: Trial, display: Display, stop: threading.Event
) -> Rewards | None:
    """Each one's mean reward; None if someone says stop meanwhile."""
    found: Rewards = {}
    for number, checkpoint in enumerate(candidates, 1):
        if stop.is_set():
            return None
        number_of = f"{number} of {len(candidates)}"
        display.say(f"trying {number_of}, {trial.episodes} episodes: {checkpoint.name}")
        found[checkpoint.name] = astuple(_tried(checkpoint, trial).reward)
    return found


def _best_first(rewards: Rewards) -> list[str]:
    return sorted(rewards, key=lambda name: rewards[name], reverse=True)


def _tried(checkpoint: Path, trial: Trial) -> Score:
    graph = policy_graph(read_weights(checkpoint), PolicyMetadata(checkpoint.name))
    policy = OnnxPolicy(graph.SerializeToString())
    driver = Driver(lambda pictures, _infos: policy.act(pictures), policy.forget)
    return score(evaluate_driver(driver, trial))
