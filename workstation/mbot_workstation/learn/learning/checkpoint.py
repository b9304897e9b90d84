"""The learner's whole state in a folder: weights, optimiser, random numbers, curriculum.

`model.zip` is a file of stable-baselines3, so its own tools read it too. It also holds pickles;
nothing here ever opens them. Only the weights and the optimiser are read, as plain tensors
(`weights_only`), so a checkpoint from a stranger can at worst be wrong, not run code.
"""

import io
import pickle
import shutil
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.learning.colour_turn import turned
from mbot_workstation.learn.learning.curriculum import CurriculumState
from mbot_workstation.learn.learning.full_speed import KEEPS_TURNS
from mbot_workstation.learn.learning.picture_ppo import PicturePPO

MODEL_FILE, STATE_FILE = "model.zip", "state.json"

_WEIGHTS = "policy.pth"
"""In `MODEL_FILE`."""


@dataclass(frozen=True, slots=True)
class RandomState:
    """Where the learner's random numbers stand; those of the robots start anew on resume.

    Attributes:
        torch_hex: of torch's generator, which draws the exploration.
        numpy_keys, numpy_position: of numpy's Mersenne Twister, which shuffles the batches.

    """

    torch_hex: str
    numpy_keys: tuple[int, ...]
    numpy_position: int

    @classmethod
    def now(cls) -> "RandomState":
        """The state at this moment."""
        numpy_state: Any = np.random.get_state()
        return cls(
            bytes(torch.get_rng_state().numpy()).hex(),
            tuple(int(key) for key in numpy_state[1]),
            int(numpy_state[2]),
        )

    def restore(self) -> None:
        """Go on from here."""
        state = np.frombuffer(bytes.fromhex(self.torch_hex), np.uint8).copy()
        torch.set_rng_state(torch.from_numpy(state))
        keys = np.array(self.numpy_keys, np.uint32)
        np.random.set_state(("MT19937", keys, self.numpy_position, 0, 0.0))


@dataclass(frozen=True, slots=True)
class CheckpointState:
    """What there is to remember beside the weights.

    Attributes:
        step: decisions so far.
        wall_s: training time so far, over all resumptions.
        curriculum: where the lessons stand.
        random: where the random numbers stand.
        mean_reward: of the last progress row; None before the first.

    """

    step: int
    wall_s: float
    curriculum: CurriculumState
    random: RandomState
    mean_reward: float | None = None


def write_checkpoint(folder: Path, learner: PicturePPO, state: CheckpointState) -> None:
    """Put a checkpoint's files into a folder."""
    learner.save(folder / MODEL_FILE)
    (folder / STATE_FILE).write_bytes(msgspec.json.encode(state))


def read_state(folder: Path) -> CheckpointState:
    """What is beside the weights.

    Raises:
        ConfigurationError: this is not a checkpoint, or of another version.

    """
    try:
        return msgspec.json.decode((folder / STATE_FILE).read_bytes(), type=CheckpointState)
    except OSError as error:
        raise ConfigurationError(f"{folder} is not a checkpoint: {error.strerror}") from None
    except msgspec.DecodeError as error:
        raise ConfigurationError(
            f"{folder / STATE_FILE} is not readable ({error}); use the checkpoint before"
        ) from None


def read_weights(folder: Path) -> dict[str, torch.Tensor]:
    """The policy's weights by name; raises as `read_state`."""
    return _read_tensors(folder, _WEIGHTS)


def write_average(folder: Path, checkpoints: Sequence[Path]) -> None:
    """Put the mean of some checkpoints' weights into a folder, with the last one's state.

    Without an optimiser's state: training goes on from checkpoints.

    Raises:
        ConfigurationError: one of them is damaged.

    """
    weights = [read_weights(checkpoint) for checkpoint in checkpoints]
    made: dict[object, torch.Tensor] = {}  # layers of several names are kept once
    mean = {
        name: made.setdefault(
            (value.data_ptr(), value.shape), torch.stack([one[name] for one in weights]).mean(0)
        )
        for name, value in weights[-1].items()
    }
    data = io.BytesIO()
    torch.save(mean, data)
    with zipfile.ZipFile(folder / MODEL_FILE, "w") as archive:
        archive.writestr(_WEIGHTS, data.getvalue())
    shutil.copy(checkpoints[-1] / STATE_FILE, folder / STATE_FILE)


def restore_learner(
    folder: Path, learner: PicturePPO, *, with_optimizer: bool, turn_deg: float = 0.0
) -> None:
    """Put a checkpoint's weights into a learner.

    A new run (without the optimiser's state) may have a memory or layers where the checkpoint has
    none: the policy does at first what it did without. A critic that another task tells other facts
    begins anew.

    Args:
        folder: the checkpoint.
        learner: of the same network.
        with_optimizer: also the optimiser's state, to go on as if nothing had happened.
        turn_deg: the hues of a new run's object are so far from those of the checkpoint's.

    Raises:
        ConfigurationError: the checkpoint is damaged, or of another network.

    """
    weights = read_weights(folder)
    if not with_optimizer:
        fresh = learner.policy.state_dict()
        weights = turned(_with_memory(_deeper(weights, fresh), fresh), turn_deg)
        weights = _with_critic(weights, fresh)
    try:
        learner.policy.load_state_dict(weights)
    except RuntimeError:
        raise ConfigurationError(
            f"{folder} holds the weights of another network; use the version that trained it"
        ) from None
    if with_optimizer:
        learner.policy.optimizer.load_state_dict(_read_tensors(folder, "policy.optimizer.pth"))


def _deeper(
    weights: dict[str, torch.Tensor], fresh: dict[str, torch.Tensor]
) -> dict[str, torch.Tensor]:
    """With the layers that the checkpoint lacks; they add nothing yet."""
    lacking = {
        name: torch.zeros_like(value)
        for name, value in fresh.items()
        if ".third." in name or ".mixing." in name
    }
    return {KEEPS_TURNS: fresh[KEEPS_TURNS]} | lacking | weights


def _with_memory(
    weights: dict[str, torch.Tensor], fresh: dict[str, torch.Tensor]
) -> dict[str, torch.Tensor]:
    """The weights of a policy without memory as those of one with: what it lacks is fresh, and the
    wheels do not listen to it yet.
    """
    if any(name.startswith("memory.") for name in weights):
        return weights
    made = {name: weights.get(name, value) for name, value in fresh.items()}
    made |= {name: value for name, value in fresh.items() if name.startswith("value_net.")}
    wheels = torch.zeros_like(fresh["action_net.weight"])
    wheels[:, : weights["action_net.weight"].shape[1]] = weights["action_net.weight"]
    return made | {"action_net.weight": wheels}


def _with_critic(
    weights: dict[str, torch.Tensor], fresh: dict[str, torch.Tensor]
) -> dict[str, torch.Tensor]:
    """With a fresh critic where that of the checkpoint does not fit."""
    critic = {name: value for name, value in fresh.items() if name.startswith("value_net.")}
    known = [weights.get(name) for name in critic]
    fits = all(
        have is not None and have.shape == value.shape
        for have, value in zip(known, critic.values(), strict=True)
    )
    return weights if fits else weights | critic


def _read_tensors(folder: Path, member: str) -> dict[str, Any]:
    path = folder / MODEL_FILE
    try:
        with zipfile.ZipFile(path) as archive:
            # Checkpoints are not packed: one that says otherwise could be of any size.
            if archive.getinfo(member).file_size > path.stat().st_size:
                raise zipfile.BadZipFile
            data = io.BytesIO(archive.read(member))
        return torch.load(data, map_location="cpu", weights_only=True)
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    except (zipfile.BadZipFile, pickle.UnpicklingError, KeyError, RuntimeError, EOFError):
        raise ConfigurationError(
            f"{path} is damaged, or holds more than numbers; use the checkpoint before"
        ) from None
