import subprocess
import sys

import numpy as np
import pytest
import torch

from mbot_workstation.training.drivers.guide import Guide
from mbot_workstation.training.learning.collection import Collection
from mbot_workstation.training.learning.learner import LearnerSettings, make_learner
from mbot_workstation.training.learning.processor import (
    has_short_floats,
    keep_freed_memory,
    prepare_gpu,
)
from mbot_workstation.training.worlds.fetch_vec_env import FetchVecEnv
from mbot_workstation.variation.presets import preset

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
def test_only_rehearsals_are_short_and_only_where_it_pays(
    has_them: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": has_them})
    settings = LearnerSettings(16, batch=16, epochs=1, guided_decisions=10**6, rehearsals=1)
    ways: list[bool] = []
    with FetchVecEnv(robots=1, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0)
        learner.collection = Collection(environment, lambda robots: Guide(robots, preset("ideal")))
        unroll = learner.policy.unroll

        def noted(*fields: torch.Tensor, short: bool) -> torch.Tensor:
            ways.append(short)
            return unroll(*fields, short=short)

        monkeypatch.setattr(learner.policy, "unroll", noted)
        learner.learn(16)
    ppo, rehearsed = ways[: -learner.update_threads], ways[-learner.update_threads :]
    assert ppo
    assert not any(ppo)
    assert rehearsed == [has_them] * learner.update_threads
    assert not has_short_floats(torch.device("cuda"))


def test_a_gpu_keeps_all_digits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", True)
    prepare_gpu()
    assert not torch.backends.cudnn.allow_tf32


def test_features_of_short_floats_are_nearly_the_same() -> None:
    with FetchVecEnv(robots=1, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, LearnerSettings(steps_per_robot=16, batch=16), seed=0)
    rng = np.random.default_rng(0)
    pictures = torch.from_numpy(rng.integers(0, 256, (4, 8, 64, 64, 3), dtype=np.uint8))
    rest = (torch.zeros(4, 8, 2), torch.zeros(4, 8), torch.zeros(8, learner.policy.units))
    with torch.no_grad():
        whole, short = (
            learner.policy.unroll(pictures, *rest, short=short) for short in (False, True)
        )
    assert short.dtype == whole.dtype == torch.float32
    assert 0 < (short - whole).norm() < 0.01 * whole.norm()
