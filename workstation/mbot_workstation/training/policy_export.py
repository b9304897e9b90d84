"""A checkpoint becomes a policy file: the graph, where it comes from, and frames to check it by."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import onnx
import torch

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.golden_frames import PROPERTY
from mbot_protocol.policy_contract import FULL_VIEW, PolicyMetadata
from mbot_workstation.training.checkpoint import (
    CheckpointState,
    read_state,
    read_weights,
)
from mbot_workstation.training.example_frames import example_frames
from mbot_workstation.training.golden_frames import golden_property
from mbot_workstation.training.policy_graph import policy_graph
from mbot_workstation.training.policy_source import Source
from mbot_workstation.training.training_config import TrainingConfig, read_config

PROVENANCE = "mbot.provenance"
"""Metadata property, a JSON object: which run, code, lessons and rooms made the model."""


def export_policy(source: Source, name: str, others: Sequence[Source] = ()) -> onnx.ModelProto:
    """Build the policy file's content.

    The same checkpoint gives the same model, on machines that render alike.

    Args:
        source: what to export.
        name: what robots call it.
        others: checkpoints to average the weights with, of runs that began with one another's
            weights: the average keeps what they agree on, and loses each one's luck.

    Raises:
        ConfigurationError: a checkpoint is unusable, or nothing can be rendered here.

    """
    config = read_config(source.run.config_file)
    state = read_state(source.checkpoint)
    model = policy_graph(
        average([read_weights(each.checkpoint) for each in (source, *others)]),
        PolicyMetadata(name, FULL_VIEW),
        {PROVENANCE: _provenance(source, others, config, state)},
    )
    golden = model.metadata_props.add()
    golden.key, golden.value = PROPERTY, golden_property(model, example_frames())
    return model


def average(weights: Sequence[Mapping[str, torch.Tensor]]) -> dict[str, torch.Tensor]:
    """The mean of several networks' weights, by name."""
    return {name: torch.stack([each[name] for each in weights]).mean(0) for name in weights[0]}


def _provenance(
    source: Source, others: Sequence[Source], config: TrainingConfig, state: CheckpointState
) -> str:
    try:
        sessions = json.loads(source.run.git_file.read_text())
        code = [session for session in sessions if session["from_step"] <= state.step][-1]
        commit, changed = code["commit"], len(code["changed_files"])
    except (OSError, ValueError, KeyError, IndexError, TypeError):
        raise ConfigurationError(
            f"{source.run.git_file} does not say which code trained; was the run copied whole?"
        ) from None
    return json.dumps(
        {
            "run": source.run.path.resolve().name,
            "averaged_with": [each.run.path.resolve().name for each in others],
            "seed": config.seed,
            "steps": state.step,
            "wall_s": round(state.wall_s),
            "robots": config.robots,
            "preset": config.preset,
            "calibration": Path(config.calibration.folder).name if config.calibration else "",
            "lessons": config.lessons,
            "lesson": config.lessons[state.curriculum.index],
            "mean_reward": state.mean_reward,
            "panoramas": [Path(panorama).name for panorama in config.panoramas],
            "made_up_rooms": config.made_up_rooms,
            "git_commit": commit,
            "git_changed_files": changed,
        },
        separators=(",", ":"),
    )
