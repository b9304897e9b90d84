"""Is a policy worth handing on? It is tried beside the colour servo before anybody else does."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mbot_protocol.errors import ContractError
from mbot_workstation.fleet.models.model_findings import examine_model
from mbot_workstation.fleet.policies.policy_card import RewardInterval, Tried
from mbot_workstation.learn.drivers.contestants import SERVO, read_policy
from mbot_workstation.learn.evaluation.episodes import Estimate, Trial, evaluate, score
from mbot_workstation.learn.worlds.example_frames import example_frames

SAME = 1e-4


def refuse_unfit(model: Path) -> None:
    """Raises ContractError: no robot takes it, or it answers every picture alike or with NaN."""
    for finding in examine_model(model):
        if finding.is_failure:
            raise ContractError(f"{model}: {finding.subject}: {finding.detail}")
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    pictures = np.stack([*example_frames().values(), noise, np.zeros_like(noise)])
    actions = read_policy(str(model)).act(pictures)
    if not np.isfinite(actions).all():
        raise ContractError(f"{model} answers a picture with NaN or infinity: train it again")
    if np.ptp(actions, axis=0).max() < SAME:
        raise ContractError(f"{model} does the same whatever it sees: train it again")


def try_beside_servo(
    model: Path, preset: str, trial: Trial, ended: Callable[[int], None] = lambda _: None
) -> Tried:
    """Both on the same robots, in the same episodes.

    Raises:
        ContractError: it is worse than the servo, beyond what chance explains.

    """
    own = score(evaluate(str(model), trial, ended)).reward
    servo = score(evaluate(SERVO, trial, ended)).reward
    if own.high < servo.low:
        raise ContractError(
            f"{model} earns {own.mean:.2f} ({own.low:.2f} to {own.high:.2f}) on {preset} robots, "
            f"the colour servo {servo.mean:.2f} ({servo.low:.2f} to {servo.high:.2f}): train it on"
        )
    return Tried(
        preset, trial.lesson.name, trial.episodes, trial.seed, _interval(own), _interval(servo)
    )


def _interval(found: Estimate) -> RewardInterval:
    return RewardInterval(found.mean, found.low, found.high)
