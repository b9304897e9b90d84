"""Who can be evaluated: any policy file, and three that are built in."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_workstation.learn.drivers.onnx_policy import Actions, OnnxPolicy, Pictures
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task


@dataclass(frozen=True, slots=True)
class Driver:
    """Somebody who drives a number of robots.

    Attributes:
        act: from what all robots see, and the infos that come with it, to their wheels. Only the
            oracle uses the latter.
        forget: which robots begin another episode, shape (robots,).

    """

    act: Callable[[Pictures, Sequence[Mapping[str, Any]]], Actions]
    forget: Callable[[NDArray[np.bool_]], None] = lambda _: None


SERVO, RANDOM, ORACLE = "servo", "random", "oracle"
BUILT_IN = (SERVO, RANDOM, ORACLE)


def driver(
    contestant: str,
    robots: int,
    seed: int,
    preset: EffectRanges,
    robot: RobotParameters | None = None,
    task: str = DEFAULT_TASK,
) -> Driver:
    """A fresh driver for so many robots.

    Args:
        contestant: "servo", "random", "oracle" or the path of an ONNX policy.
        robots: how many it drives.
        seed: of the random one.
        preset: what the robots are like, for the oracle.
        robot: what the preset starts from, for the oracle; the nominal one when None.
        task: by its name or file, for the oracle.

    Raises:
        ConfigurationError: there is no such contestant or file.
        ContractError: the file is not a policy.

    """
    if contestant == ORACLE:
        expert = find_task(task).expert(robots, preset, robot or RobotParameters())
        if expert is None:
            raise ConfigurationError(f"the task {task} has no oracle: nobody is told the truth")
        return Driver(lambda _pictures, infos: expert(infos))
    if contestant == RANDOM:
        rng = np.random.default_rng(seed)
        return Driver(lambda pictures, _infos: _draw(rng, len(pictures)))
    policy = read_policy(contestant)
    return Driver(lambda pictures, _infos: policy.act(pictures), policy.forget)


def read_policy(contestant: str) -> OnnxPolicy:
    """The servo, or the policy in a file.

    Raises:
        ConfigurationError: there is no such file.
        ContractError: the file is not a policy.

    """
    return _servo() if contestant == SERVO else _load(contestant)


def check_contestants(contestants: Sequence[str]) -> None:
    """Refuse at once what could not drive when its turn comes; raises as `read_policy`."""
    for contestant in contestants:
        if contestant not in BUILT_IN:
            _load(contestant)


def title(contestant: str) -> str:
    """A short name for tables."""
    return contestant if contestant in BUILT_IN else Path(contestant).stem


def titles(contestants: Sequence[str]) -> dict[str, str]:
    """Contestants by their names in tables; two files of the same name keep their paths."""
    short = [title(contestant) for contestant in contestants]
    return {
        contestant: contestant if short.count(name) > 1 else name
        for contestant, name in zip(contestants, short, strict=True)
    }


def _load(contestant: str) -> OnnxPolicy:
    path = Path(contestant)
    if not path.exists():
        raise ConfigurationError(
            f"no policy {contestant!r}: expected an ONNX file, or one of {', '.join(BUILT_IN)}"
        )
    return OnnxPolicy.load(path)


def _servo() -> OnnxPolicy:
    """The colour servo, as `workstation make-servo-policy` writes it."""
    from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model

    return OnnxPolicy(servo_model(ServoGains(), PolicyMetadata(SERVO)).SerializeToString())


def _draw(rng: np.random.Generator, robots: int) -> Actions:
    return rng.uniform(-1, 1, (robots, 2)).astype(np.float32)
