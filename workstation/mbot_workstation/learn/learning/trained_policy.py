"""A trained network and where it comes from: of a run's checkpoint, or out of a policy file."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import onnx
import torch

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.models.check import check_model
from mbot_workstation.fleet.models.trained_object import told_object
from mbot_workstation.learn.learning.checkpoint import CheckpointState, read_state, read_weights
from mbot_workstation.learn.learning.policy_graph import graph_weights
from mbot_workstation.learn.learning.policy_source import Source, find_source
from mbot_workstation.learn.learning.training_config import TrainingConfig, read_config
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task, task_digest

PROVENANCE = "mbot.provenance"
"""Metadata property, a JSON object: which run, code, lessons and rooms made the model."""


@dataclass(frozen=True, slots=True, eq=False)
class TrainedPolicy:
    """A network.

    Attributes:
        weights: by SB3's names.
        provenance: see `PROVENANCE`.
        checkpoint: or the policy file it was read from.
        name: of its run, or of the file.
        object_file: of a run that did not learn the red cube.

    """

    weights: Mapping[str, torch.Tensor]
    provenance: Mapping[str, Any]
    checkpoint: Path
    name: str
    object_file: str = ""


def _task(reference: str) -> dict[str, str]:
    return {"task": find_task(reference).name, "task_sha256": task_digest(reference)}


def trained_policy(path: Path, task: str = DEFAULT_TASK) -> TrainedPolicy:
    """Read a run's chosen checkpoint, a certain one, or a file that `workstation export` wrote.

    `task` as for `read_config`.

    Raises:
        ConfigurationError: it is none of these, or damaged.
        ContractError: the file is not a policy.

    """
    if path.is_file():
        return _of_file(path)
    source = find_source(path)
    config, state = read_config(source.run.config_file, task), read_state(source.checkpoint)
    return TrainedPolicy(
        read_weights(source.checkpoint),
        provenance(source, config, state),
        source.checkpoint,
        source.run.path.resolve().name,
        config.object_file,
    )


def _of_file(path: Path) -> TrainedPolicy:
    model = onnx.load_from_string(check_model(path).data)
    properties = {entry.key: entry.value for entry in model.metadata_props}
    try:
        return TrainedPolicy(
            graph_weights(model), json.loads(properties[PROVENANCE]), path, path.stem
        )
    except (KeyError, ValueError):
        raise ConfigurationError(
            f"{path} was not written by `workstation export`: expected one of its files, or a "
            "run's folder"
        ) from None


def provenance(source: Source, config: TrainingConfig, state: CheckpointState) -> dict[str, Any]:
    """See `PROVENANCE`; raises ConfigurationError if the run doesn't say which code trained it."""
    try:
        sessions = json.loads(source.run.git_file.read_text())
        code = [session for session in sessions if session["from_step"] <= state.step][-1]
        commit, changed = code["commit"], len(code["changed_files"])
    except (OSError, ValueError, KeyError, IndexError, TypeError):
        raise ConfigurationError(
            f"{source.run.git_file} does not say which code trained; was the run copied whole?"
        ) from None
    thing = told_object(config.object_file) if config.object_file else None
    return {
        "run": source.run.path.resolve().name,
        "seed": config.seed,
        "steps": state.step,
        "checkpoint": source.checkpoint.name,
        "wall_s": round(state.wall_s),
        "robots": config.robots,
        "preset": config.preset,
        "calibration": Path(config.calibration.folder).name if config.calibration else "",
        "lessons": [stage.name for stage in config.stages()],
        "lesson": config.stages()[state.curriculum.index].name,
        "mean_reward": state.mean_reward,
        "panoramas": [photograph.name for photograph in config.photographs],
        "made_up_rooms": config.made_up_rooms,
        **({"drives": [Path(drive).name for drive in config.drives]} if config.drives else {}),
        "git_commit": commit,
        "git_changed_files": changed,
        # Models of before there were tasks say nothing: it was this one.
        **({} if config.task == DEFAULT_TASK else _task(config.task)),
        **({} if thing is None else {"object": msgspec.to_builtins(thing)}),
    }
