import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.learner import GUIDED, LearnerSettings, make_learner
from mbot_workstation.learn.learning.processor import (
    has_short_floats,
    keep_freed_memory,
    prepare_gpu,
)
from mbot_workstation.learn.learning.trained_policy import trained_policy
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.tasks.fetch.guide import FetchGuide
from mbot_workstation.tasks.fetch.task import TASK

RUN = Path(__file__).parents[2] / "models" / "red-cube-run"

LAYERS = """
import resource, threading
import numpy as np
{}
def update():
    layers = [np.ones(2**18) for _ in range(8)]  # 2 MiB each
def pages():
    for _ in range(3):
        update()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        update()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
thread = threading.Thread(target=pages)
thread.start()
thread.join()
"""
"""How many pages a thread gets from the kernel that allocates the same again and again."""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no mallopt")
def test_freed_memory_is_not_fetched_again() -> None:
    keep = f"from {keep_freed_memory.__module__} import keep_freed_memory\nkeep_freed_memory()"
    pages = [
        int(subprocess.check_output([sys.executable, "-c", LAYERS.format(first)], timeout=60))
        for first in ("", keep)
    ]
    assert pages[0] > 10_000, "81,920 pages of 4 KiB are allocated"
    assert pages[1] < 100


@pytest.mark.slow
@pytest.mark.parametrize("has_them", [True, False])
def test_updates_are_short_only_where_it_pays(
    has_them: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": has_them})
    settings = LearnerSettings(16, batch=16, epochs=1, guided_decisions=10**6, rehearsals=1)
    ways: list[bool] = []
    with TaskVecEnv(robots=1, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(
            environment, lambda robots: FetchGuide(robots, preset("ideal"))
        )
        unroll = learner.policy.unroll

        def noted(*fields: torch.Tensor, short: bool) -> torch.Tensor:
            ways.append(short)
            return unroll(*fields, short=short)

        monkeypatch.setattr(learner.policy, "unroll", noted)
        learner.learn(16)
    assert len(ways) > learner.update_threads, "PPO's own part and a rehearsal"
    assert ways == [has_them] * len(ways)
    assert not has_short_floats(torch.device("cuda"))


@pytest.mark.slow
def test_a_ratio_of_short_floats_is_near_one_before_anything_is_learned() -> None:
    """With the policy that ships and the least noise there is, which divides what it is off."""
    # The network of the policy that ships, whose weights are looked at.
    ships = replace(GUIDED, first_filter_px=6, residual=False)
    still = replace(ships, learning_rate=0.0, final_learning_rate=0.0, rehearsals=0)
    settings = replace(still, steps_per_robot=128, batch=512, noise=GUIDED.final_noise)
    rooms = [generate_room(seed, 512) for seed in range(4)]
    with TaskVecEnv(4, 1, "randomised", "10", rooms, workers=1) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.policy.load_state_dict(trained_policy(RUN).weights, strict=True)
        learner.policy.log_std.data.fill_(math.log(settings.final_noise))
        learner.collection = Collection(environment)
        learner.learn(512)
    (batch,) = learner.rollout_buffer.sequences(512)
    fields = (batch.seen, batch.previous_actions, batch.forgot, batch.state)
    changes: list[torch.Tensor] = []
    with torch.no_grad():
        for short in (False, True):
            known = learner.policy.unroll(*map(torch.from_numpy, fields), short=short)
            actions, truth = (
                torch.from_numpy(one).flatten(0, 1) for one in (batch.actions, batch.truth)
            )
            judged = learner.policy.judge(known, actions, truth)
            changes.append(judged.log_probs - torch.from_numpy(batch.old_log_prob).flatten())
    whole, short = changes
    assert whole.abs().max() < 1e-4
    assert 1e-4 < short.square().mean().sqrt() < 0.02
    assert short.exp().sub(1).abs().max() < settings.clip_range


def test_a_gpu_keeps_all_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", True)
    prepare_gpu()
    assert not torch.backends.cudnn.allow_tf32


def test_features_of_short_floats_are_nearly_the_same() -> None:
    with TaskVecEnv(robots=1, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(
            environment, LearnerSettings(steps_per_robot=16, batch=16), seed=0, critic=TASK.critic
        )
    rng = np.random.default_rng(0)
    pictures = torch.from_numpy(rng.integers(0, 256, (4, 8, 64, 64, 3), dtype=np.uint8))
    rest = (torch.zeros(4, 8, 2), torch.zeros(4, 8), torch.zeros(8, learner.policy.units))
    with torch.no_grad():
        whole, short = (
            learner.policy.unroll(pictures, *rest, short=short) for short in (False, True)
        )
    assert short.dtype == whole.dtype == torch.float32
    assert 0 < (short - whole).norm() < 0.01 * whole.norm()
