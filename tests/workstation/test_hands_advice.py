"""A hand's beats are advice beside simulated advice, the memory warmed up on what came before."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import torch

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli import train as command
from mbot_workstation.learn.learning import run_plan
from mbot_workstation.learn.learning.advice_memory import AdviceMemory
from mbot_workstation.learn.learning.checkpoint import read_weights
from mbot_workstation.learn.learning.full_speed import KEEPS_TURNS
from mbot_workstation.learn.learning.hands_advice import as_seen, hands_advice
from mbot_workstation.learn.learning.learner import LearnerSettings, make_learner
from mbot_workstation.learn.learning.picture_ppo import PicturePPO
from mbot_workstation.learn.learning.training_config import read_config
from mbot_workstation.learn.learning.training_run import begin_run
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.look.collect.reviews import Review, write_review
from mbot_workstation.pictures.picture_file import observation
from mbot_workstation.tasks.fetch.task import TASK

from .hand_driven import BY_HAND, BY_POLICY, FACTS, hand_driven
from .test_train import TINY, run_to_end

HAND, POLICY = (0.4, -0.2), (0.5, 0.5)


def changed(drive: Path, path: Path, change: Any) -> str:
    """A copy of a recording, its beats changed."""
    with closing(BeatWriter(path, "mbot-1", "test", FACTS)) as writer:
        for beat in read_drive(drive).beats:
            if (made := change(beat)) is not None:
                writer.write(made)
    return str(path)


def test_a_hands_beats_are_advice_and_the_policys_only_warm_up(tmp_path: Path) -> None:
    drive = hand_driven(tmp_path / "drive")
    found = hands_advice([str(drive)], length=16, units=5)
    assert found.seen.shape == (16, 1, 64, 64, 3)
    advised = np.isfinite(found.advice[:, 0, 0])
    assert advised.tolist() == [False] * BY_POLICY + [True] * BY_HAND + [False] * 6
    np.testing.assert_allclose(found.advice[advised], [[HAND]] * BY_HAND, atol=0.005)
    told = [(0.0, 0.0)] + [POLICY] * BY_POLICY + [HAND] * (BY_HAND - 1)
    np.testing.assert_allclose(found.previous_actions[:10, 0], told, atol=0.005)
    assert found.forgot[:, 0].tolist() == [1.0] + [0.0] * 15
    for seen, beat in zip(found.seen[:, 0], read_drive(drive).beats[:10], strict=False):
        shown = observation(beat)
        assert shown is not None
        assert np.array_equal(seen, shown)


@pytest.mark.parametrize("length", [4, 6, 8, 32])
def test_each_of_a_hands_beats_is_advice_once(tmp_path: Path, length: int) -> None:
    drives = [str(hand_driven(tmp_path / str(seed), seed, rounds=3)) for seed in (1, 2)]
    found = hands_advice(drives, length, units=0)
    advised = np.isfinite(found.advice[..., 0])
    assert advised.sum() == 2 * 3 * BY_HAND
    pictures = found.seen[advised].reshape(2 * 3 * BY_HAND, -1)
    assert len(np.unique(pictures, axis=0)) == len(pictures)
    if length == 8:
        assert not advised[:4, 0].any(), "half of it is what came before"


def test_a_gap_empties_the_memory(tmp_path: Path) -> None:
    drive = hand_driven(tmp_path / "drive")
    lacks = changed(
        drive, tmp_path / "gap.mcap", lambda one: one if one.decision.sequence != 106 else None
    )
    found = hands_advice([lacks], length=8, units=0)
    assert found.forgot.shape == (8, 2)
    assert np.isfinite(found.advice).all(axis=2).sum() == BY_HAND - 1
    assert not found.previous_actions[0].any()
    anew = changed(drive, tmp_path / "anew.mcap", _begun_anew)
    assert hands_advice([anew], length=16, units=0).forgot.shape == (16, 2)


def _begun_anew(beat: Any) -> Any:
    known = msgspec.structs.replace(beat.policy_input, began_anew=beat.decision.sequence == 107)
    return replace(beat, policy_input=known)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda one: replace(one, is_exact=False), "of telemetry.*recordings fetch"),
        (lambda one: one if not one.by_hand else None, "no hand has driven in the 1 drives"),
        (
            lambda one: replace(
                one, policy_input=msgspec.structs.replace(one.policy_input, view_horizontal_deg=80)
            ),
            r"show 80 x 42\.9 degrees.*drives drop",
        ),
    ],
)
def test_what_nobody_can_learn_from_is_one_line(tmp_path: Path, change: Any, words: str) -> None:
    drive = changed(hand_driven(tmp_path / "drive"), tmp_path / "other.mcap", change)
    with pytest.raises(ConfigurationError, match=words) as refused:
        hands_advice([drive], length=16, units=0)
    assert "\n" not in str(refused.value)


def learner(settings: LearnerSettings) -> PicturePPO:
    with TaskVecEnv(robots=1, preset="ideal", workers=1) as environment:
        return make_learner(environment, settings, seed=0, critic=TASK.critic)


@pytest.mark.parametrize("keeps_eye", [False, True])
def test_a_batch_is_real_by_its_share(tmp_path: Path, keeps_eye: bool) -> None:
    made = learner(replace(TINY.learner, residual=True, rehearsal_batch=256))
    real = hands_advice([str(hand_driven(tmp_path / "drive"))], 16, made.policy.units)
    if keeps_eye:
        made.keep_eye(None)
    simulated = replace(real, advice=np.full_like(real.advice, 7))
    if keeps_eye:
        simulated = as_seen(simulated, made.policy.features_extractor)
    made._memory = AdviceMemory(1000)  # pyright: ignore[reportPrivateUsage]
    made._memory.add(simulated)  # pyright: ignore[reportPrivateUsage]
    made.rehearse_beside(real, 0.25)
    batch = made._rehearsal(1)  # pyright: ignore[reportPrivateUsage]
    assert batch.forgot.shape == (16, 16)
    assert (batch.advice[-1] == 7).all(axis=1).sum() == 12, "a quarter is real"
    assert batch.seen.shape[2:] == ((256,) if keeps_eye else (64, 64, 3))
    assert all(gradient.isfinite().all() for gradient in made._advice_gradients(batch))  # pyright: ignore[reportPrivateUsage]
    made.rehearse_beside(real, 1.0)
    assert not (made._rehearsal(1).advice == 7).any()  # pyright: ignore[reportPrivateUsage]


@pytest.mark.parametrize("residual", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_run_goes_on_by_the_hands_of_its_drives(tmp_path: Path, residual: bool) -> None:
    tiny = replace(TINY, steps=64, learner=replace(TINY.learner, residual=residual))
    parent = begin_run(tmp_path / "parent", tiny)
    run_to_end(parent, read_config(parent.config_file))
    drives = tmp_path / "drives"
    write_review(hand_driven(drives / "mbot-1" / "drive-1"), Review("keep", "training"))
    write_review(hand_driven(drives / "mbot-1" / "drive-2", seed=2), Review("keep", "judging"))
    options = command.TrainOptions(parent=parent.path, drives=drives, real_share=0.5)
    config = command._configured(options)  # pyright: ignore[reportPrivateUsage]
    assert [Path(one).name for one in config.drives] == ["drive-1"], "none of what judges"
    guided = config.learner.guided_decisions
    assert (config.steps, guided) == (run_plan.DRIVES_STEPS, run_plan.DRIVES_GUIDED)
    small = replace(TINY.learner, guided_decisions=96, rehearsals=3, residual=residual)
    small = replace(small, eye_pictures=64 if residual else 0)
    config = replace(config, robots=2, workers=1, steps=64, made_up_rooms=1, learner=small)
    config = replace(config, shipped_photographs=False, preset="ideal", lessons=("10",))
    run = begin_run(tmp_path / "run", config)
    run_to_end(run, read_config(run.config_file))
    before, after = (read_weights(one.last_checkpoint()) for one in (parent, run))
    assert not torch.equal(before["memory.weight_ih"], after["memory.weight_ih"])
    same = [torch.equal(one, after[name]) for name, one in before.items() if "extractor" in name]
    assert all(same) == residual, "who has learned to see sees as before"
    assert torch.equal(before[KEEPS_TURNS], after[KEEPS_TURNS])


@pytest.mark.parametrize("options", [{}, {"parent": Path("run"), "guide": 0}])
def test_drives_want_a_trained_policy_and_a_guide(options: dict[str, Any]) -> None:
    plan = run_plan.RunPlan(memory_units=128, drives=(Path("drive"),), **options)
    with pytest.raises(ConfigurationError, match="add --from RUN"):
        plan.config()
