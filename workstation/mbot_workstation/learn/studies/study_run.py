"""A study: the same drivers under one condition after the other, on all cores."""

import importlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import joblib

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.drivers.contestants import title
from mbot_workstation.learn.evaluation.episodes import EpisodeResult, Trial, evaluate, score
from mbot_workstation.learn.evaluation.evaluation_report import Line
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.tasks.find import is_file

CLUSTERS = {"dask": "distributed", "ray": "ray"}
"""Back ends of joblib, and the packages they come from."""

BACKENDS = ("threading", *CLUSTERS)


@dataclass(frozen=True, slots=True)
class Condition:
    """One set of robots to try drivers on.

    Attributes:
        label: for tables.
        effects: the robots.
        value: on the study's axis, where it has one.

    """

    label: str
    effects: EffectRanges
    value: float | None = None


@dataclass(frozen=True, slots=True)
class Study:
    """What is varied, and why.

    Attributes:
        name: of its files.
        heading: of its report.
        question: what it is to answer.
        conditions: in the order of the report.
        axis: what `Condition.value` is, with its unit; empty where there is none.

    """

    name: str
    heading: str
    question: str
    conditions: tuple[Condition, ...]
    axis: str = ""


def run_study(
    conditions: Sequence[Condition],
    contestants: Sequence[str],
    trial: Trial,
    backend: str = "threading",
    ended: Callable[[int], None] = lambda _: None,
) -> list[Line]:
    """Try every contestant under every condition.

    Args:
        conditions: what to vary.
        contestants: who drives.
        trial: the rest: lesson, rooms, episodes, seed. Its preset is not used.
        backend: joblib's. "threading" uses this machine's cores: each thread waits for a process
            of its own that simulates. "dask" and "ray" use the cluster that their own libraries
            have connected to.
        ended: called with the number of finished combinations.

    Returns:
        A line a combination, by condition, then contestant.

    Raises:
        ConfigurationError: there is no such back end, or its package is missing.

    """
    if backend not in BACKENDS:
        raise ConfigurationError(f"no back end {backend!r}, expected one of {', '.join(BACKENDS)}")
    combinations = [
        (condition, contestant) for condition in conditions for contestant in contestants
    ]
    jobs = os.cpu_count() or 1
    if backend in CLUSTERS:
        if is_file(trial.task):
            raise ConfigurationError(
                f"{backend} sends no files: a task of a file runs on threading"
            )
        _register(backend)
        jobs = -1  # all there are
    with joblib.parallel_config(backend=backend, n_jobs=jobs):
        # Each with one process of its own: as many at once as there are cores.
        found: Any = joblib.Parallel(return_as="generator")(
            joblib.delayed(_evaluate)(
                contestant, replace(trial, preset=condition.effects, workers=1)
            )
            for condition, contestant in combinations
        )
        lines: list[Line] = []
        for (condition, contestant), results in zip(combinations, found, strict=True):
            lines.append(Line(title(contestant), condition.label, score(results)))
            ended(len(lines))
    return lines


def _evaluate(contestant: str, trial: Trial) -> list[EpisodeResult]:
    return evaluate(contestant, trial)


def _register(backend: str) -> None:
    """Make a cluster's back end known to joblib."""
    try:
        if backend == "ray":
            importlib.import_module("ray.util.joblib").register_ray()
        else:  # joblib knows dask's as soon as its package can be imported
            importlib.import_module(CLUSTERS[backend])
    except ImportError:
        raise ConfigurationError(
            f"the back end {backend!r} needs the package {CLUSTERS[backend]!r}: install it with pip"
        ) from None
