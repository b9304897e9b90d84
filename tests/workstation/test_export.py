import base64
import hashlib
import json
import os
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read when onnxruntime is imported

import numpy as np
import onnx
import pytest
import torch
from onnx import numpy_helper
from stable_baselines3.common.vec_env import DummyVecEnv

from mbot_protocol.errors import ConfigurationError, ContractError
from mbot_protocol.policy.golden_frames import PROPERTY
from mbot_protocol.policy.policy_contract import FULL_VIEW, PolicyMetadata
from mbot_workstation.cli.train import export
from mbot_workstation.fleet.models.check import check_model
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
from mbot_workstation.learn.drivers.onnx_policy import OnnxPolicy
from mbot_workstation.learn.learning.checkpoint import (
    CheckpointState,
    RandomState,
    read_weights,
    write_checkpoint,
)
from mbot_workstation.learn.learning.curriculum import CurriculumState
from mbot_workstation.learn.learning.full_speed import KEEPS_TURNS, within_full_speed
from mbot_workstation.learn.learning.learner import LearnerSettings, make_learner
from mbot_workstation.learn.learning.memory_policy import ACTIONS, PolicyInput
from mbot_workstation.learn.learning.picture_ppo import PicturePPO
from mbot_workstation.learn.learning.policy_export import check_golden_frames, golden_property
from mbot_workstation.learn.learning.policy_graph import graph_weights, policy_graph
from mbot_workstation.learn.learning.run_directory import RunDirectory, write_json
from mbot_workstation.learn.learning.trained_policy import PROVENANCE, trained_policy
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.learning.training_run import begin_run
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.tasks.fetch.task import TASK

from .called import output_of

PICTURES = np.random.default_rng(5).integers(0, 256, (40, 64, 64, 3)).astype(np.uint8)
CONFIG = TrainingConfig(panoramas=("/somewhere/private/hall.jpg",), seed=4)
COMMIT = "c" * 40
MODELS = Path(__file__).parents[2] / "models"


@pytest.fixture(scope="module")
def learner() -> PicturePPO:
    environment = DummyVecEnv([TaskEnv])
    made = make_learner(
        environment,
        LearnerSettings(batch=128, residual=True),
        seed=1,
        critic=TASK.critic,
    )
    environment.close()
    with torch.no_grad():  # lively enough that actions leave [-1, 1]
        for parameter in made.policy.parameters():
            parameter.mul_(1.5).add_(0.02 * torch.randn_like(parameter))
        nothing = torch.zeros(len(PICTURES), ACTIONS)
        state = torch.zeros(len(PICTURES), made.policy.units)
        before = PolicyInput(torch.from_numpy(PICTURES), state, nothing)
        actions = made.policy.decide(before).actions
        made.policy.get_parameter("action_net.bias").sub_(actions.mean(0))
    return made


@pytest.fixture(scope="module")
def run(learner: PicturePPO, tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    made = begin_run(tmp_path_factory.mktemp("runs") / "first", CONFIG)
    write_json(
        made.git_file,
        [
            {"from_step": 0, "commit": "b" * 40, "changed_files": []},
            {"from_step": 40_000, "commit": COMMIT, "changed_files": ["a", "b"]},
            {"from_step": 90_000, "commit": "d" * 40, "changed_files": []},
        ],
    )
    state = CheckpointState(80_000, 61.2, CurriculumState(index=6), RandomState.now(), 4.5)
    made.add_checkpoint(80_000, lambda folder: write_checkpoint(folder, learner, state))
    return made


def properties(model: onnx.ModelProto) -> dict[str, str]:
    return {entry.key: entry.value for entry in model.metadata_props}


invoke = partial(output_of, export)


FLOAT32 = 1e-4
"""Two engines sum the same 32-bit products in another order. An action is made of some thousand of
them, with activations of about 10 and an unlearned network's actions far beyond 1: 10 x 6e-8 x
sqrt(5000) is 4e-5 (1.2e-5 was seen). A wheel's smallest step is 4e-3."""


def test_onnx_decides_as_the_learner_does(learner: PicturePPO, run: RunDirectory) -> None:
    model = policy_graph(read_weights(run.last_checkpoint()), PolicyMetadata("first"))
    policy = OnnxPolicy(model.SerializeToString())
    robots = len(PICTURES)
    state, told = torch.zeros(robots, learner.policy.units), torch.zeros(robots, 2)
    for moment in range(4):
        ours = policy.act(PICTURES)
        before = PolicyInput(torch.from_numpy(PICTURES), state, told)
        with torch.no_grad():
            decided = learner.policy.decide(before)
        theirs = within_full_speed(decided.actions)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=FLOAT32)
        assert (np.abs(ours) == 1.0).any(), "the test must reach full speed"
        assert (np.abs(ours) < 1.0).any()
        forgets = np.arange(len(PICTURES)) % 3 == moment
        policy.forget(forgets)
        keep = torch.from_numpy(~forgets).float().unsqueeze(1)
        state, told = decided.state * keep, torch.from_numpy(np.round(ours * 250) / 250) * keep
        told = told.float()


def test_a_network_without_memory_follows_the_first_contract() -> None:
    environment = DummyVecEnv([TaskEnv])
    plain = make_learner(
        environment, LearnerSettings(batch=128, memory_units=0), seed=2, critic=TASK.critic
    )
    environment.close()
    torch.nn.init.normal_(plain.policy.action_net.weight, std=0.1)
    model = policy_graph(plain.policy.state_dict(), PolicyMetadata("plain"))
    assert [one.name for one in model.graph.input] == ["observation"]
    policy = OnnxPolicy(model.SerializeToString())
    assert policy.metadata.contract_version == 1
    theirs, _ = plain.policy.predict(PICTURES, deterministic=True)
    np.testing.assert_allclose(policy.act(PICTURES), theirs, rtol=0, atol=FLOAT32)


@pytest.mark.parametrize(
    ("memory_units", "first_filter_px", "residual"),
    [(0, 8, False), (128, 8, False), (128, 6, False), (128, 8, True), (0, 8, True)],
)
def test_the_dialect_for_armv6_decides_alike_and_has_the_same_weights(
    memory_units: int, first_filter_px: int, residual: bool
) -> None:
    environment = DummyVecEnv([TaskEnv])
    settings = LearnerSettings(
        batch=128,
        memory_units=memory_units,
        first_filter_px=first_filter_px,
        residual=residual,
    )
    made = make_learner(environment, settings, seed=3, critic=TASK.critic)
    environment.close()
    torch.nn.init.normal_(made.policy.action_net.weight, std=0.1)
    weights = made.policy.state_dict()
    usual, dialect = (
        policy_graph(weights, PolicyMetadata("one"), for_armv6=for_armv6)
        for for_armv6 in (False, True)
    )
    assert dialect.opset_import[0].version == 10
    assert "GRU" not in {node.op_type for node in dialect.graph.node}
    ours, theirs = (OnnxPolicy(model.SerializeToString()) for model in (dialect, usual))
    for picture in PICTURES[:10]:
        np.testing.assert_allclose(
            ours.act(picture[None]), theirs.act(picture[None]), rtol=0, atol=FLOAT32
        )
    back, before = graph_weights(dialect), graph_weights(usual)
    assert back.keys() == before.keys()
    for name, weight in back.items():
        torch.testing.assert_close(weight, before[name])


def test_weights_of_before_are_bounded_as_they_were_trained(learner: PicturePPO) -> None:
    """Each wheel by itself: what was exported once must not drive otherwise in another dialect."""
    weights = learner.policy.state_dict()
    assert KEEPS_TURNS in weights
    before = {name: value for name, value in weights.items() if name != KEEPS_TURNS}
    kinds = [
        [node.op_type for node in policy_graph(one, PolicyMetadata("one")).graph.node][-3:]
        for one in (weights, before)
    ]
    assert kinds == [["Gemm", "Add", "Clip"], ["Concat", "Gemm", "Clip"]]
    old = policy_graph(before, PolicyMetadata("one"))
    assert KEEPS_TURNS not in graph_weights(old)


@pytest.mark.slow
def test_a_file_for_armv6_is_an_option_away_and_robots_take_it(
    run: RunDirectory, tmp_path: Path
) -> None:
    first, dialect, back = (tmp_path / f"{name}.onnx" for name in ("first", "armv6", "back"))
    invoke(str(run.path), "-o", str(first), "--name", "same")
    invoke(str(first), "-o", str(dialect), "--name", "same", "--for-armv6")
    invoke(str(dialect), "-o", str(back), "--name", "same")
    assert check_model(dialect).metadata == PolicyMetadata("same", FULL_VIEW, 2.5, 2)
    assert dialect.read_bytes() != first.read_bytes()
    assert back.read_bytes() == first.read_bytes()


def test_a_batch_is_as_many_robots_each_with_its_memory(run: RunDirectory) -> None:
    model = policy_graph(read_weights(run.last_checkpoint()), PolicyMetadata("first"))
    together, alone = (OnnxPolicy(model.SerializeToString()) for _ in range(2))
    pictures = PICTURES[:6].reshape(3, 2, 64, 64, 3)  # of two robots
    ours = np.array([together.act(two) for two in pictures])
    for robot in range(2):
        alone.forget()
        one = np.array([alone.act(pictures[moment, robot][None])[0] for moment in range(3)])
        np.testing.assert_allclose(one, ours[:, robot], rtol=0, atol=FLOAT32)
    first, again = together.act(PICTURES), together.act(PICTURES)
    assert np.abs(first - again).max() > 0.01, "it remembers"


def test_robots_take_the_file(run: RunDirectory, tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    told = json.loads(invoke(str(run.path), "-o", str(path), "--json"))
    data = path.read_bytes()
    assert told == {
        "path": str(path),
        "name": "policy",
        "sha256": hashlib.sha256(data).hexdigest(),
        "checkpoint": str(run.last_checkpoint()),
        "size_bytes": len(data),
    }
    with pytest.raises(ConfigurationError, match="exists already; choose another name"):
        invoke(str(run.path), "-o", str(path))
    assert path.read_bytes() == data
    assert check_model(path).metadata == PolicyMetadata("policy", FULL_VIEW, 2.5, 2)
    model = onnx.load_from_string(data)
    assert model.opset_import[0].version <= 17
    assert model.ir_version <= 10
    assert len(data) < 5e6
    assert path.parent.joinpath("policy.onnx.data").exists() is False


def test_the_file_says_where_it_comes_from(run: RunDirectory, tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    invoke(str(run.last_checkpoint()), "-o", str(path))
    model = onnx.load(path)
    origin = json.loads(properties(model)[PROVENANCE])
    assert origin["run"] == "first"
    assert (origin["steps"], origin["seed"], origin["lesson"]) == (80_000, 4, "7")
    assert (origin["git_commit"], origin["git_changed_files"]) == (COMMIT, 2)
    assert origin["mean_reward"] == 4.5
    assert origin["panoramas"] == ["hall.jpg"]
    assert "private" not in str(model.metadata_props)


def test_a_policy_file_can_be_exported_again(run: RunDirectory, tmp_path: Path) -> None:
    first, again = tmp_path / "first.onnx", tmp_path / "again.onnx"
    invoke(str(run.path), "-o", str(first), "--name", "same")
    for name, weight in trained_policy(first).weights.items():
        torch.testing.assert_close(weight, trained_policy(run.path).weights[name])
    invoke(str(first), "-o", str(again), "--name", "same")
    origins = [properties(onnx.load(path))[PROVENANCE] for path in (first, again)]
    assert origins[0] == origins[1]


def test_a_policy_that_was_not_exported_here_cannot_be_exported_again(tmp_path: Path) -> None:
    path = tmp_path / "servo.onnx"
    path.write_bytes(servo_model(ServoGains(), PolicyMetadata("servo")).SerializeToString())
    with pytest.raises(ConfigurationError, match="was not written by `workstation export`"):
        invoke(str(path))


def test_golden_frames_travel_along_and_are_checked(run: RunDirectory, tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    invoke(str(run.path), "-o", str(path), "--name", "golden")
    model = onnx.load(path)
    entries = json.loads(properties(model)[PROPERTY])
    assert [number for number, entry in enumerate(entries) if entry["fresh"]] == [0, 40]
    assert len(entries) == 80
    assert all(base64.b64decode(entry["png"]).startswith(b"\x89PNG") for entry in entries)
    deviation = check_golden_frames(model)
    assert deviation is not None
    assert deviation < 1e-5
    (wheels,) = [tensor for tensor in model.graph.initializer if tensor.name == "wheels.weight"]
    wheels.CopyFrom(numpy_helper.from_array(-numpy_helper.to_array(wheels), wheels.name))
    with pytest.raises(ContractError, match="golden frames are off"):
        check_golden_frames(model)


def test_a_model_without_golden_frames_is_no_mistake_but_damaged_ones_are(
    run: RunDirectory,
) -> None:
    model = policy_graph(read_weights(run.last_checkpoint()), PolicyMetadata("plain"))
    assert check_golden_frames(model) is None
    entry = model.metadata_props.add()
    entry.key = PROPERTY
    good = golden_property(model, [(PICTURES[0], True), (PICTURES[1], False)])
    for text in ("{", "[]", "[{}]", good.replace('"png":"', '"png":"AAAA'), "[1]"):
        entry.value = text
        with pytest.raises(ContractError, match="damaged"):
            check_golden_frames(model)
    entry.value = good
    assert check_golden_frames(model) == pytest.approx(0.0, abs=1e-6)


def test_the_same_checkpoint_gives_the_same_file(run: RunDirectory, tmp_path: Path) -> None:
    files = [tmp_path / "one" / "p.onnx", tmp_path / "two" / "p.onnx"]
    for path in files:
        path.parent.mkdir()
        invoke(str(run.path), "-o", str(path))
    assert files[0].read_bytes() == files[1].read_bytes()


def test_what_ships_is_what_its_run_exports(tmp_path: Path) -> None:
    """But for golden answers, whose last digits depend on the processor."""
    invoke(str(MODELS / "red-cube-run"), "-o", str(tmp_path / "red-cube.onnx"))
    ours, shipped = (onnx.load(f / "red-cube.onnx") for f in (tmp_path, MODELS))
    assert ours.graph.SerializeToString(deterministic=True) == shipped.graph.SerializeToString(
        deterministic=True
    )
    said = [{one.key: one.value for one in model.metadata_props} for model in (ours, shipped)]
    assert said[0][PROVENANCE] == said[1][PROVENANCE]


def test_what_cannot_be_exported_is_named(
    run: RunDirectory, learner: PicturePPO, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match="not a training run"):
        invoke(str(tmp_path))
    empty = begin_run(tmp_path / "empty", replace(CONFIG, seed=1))
    with pytest.raises(ConfigurationError, match="no checkpoint yet"):
        invoke(str(empty.path))
    with pytest.raises(ConfigurationError, match="there is no folder"):
        invoke(str(run.path), "-o", str(tmp_path / "missing" / "p.onnx"))
