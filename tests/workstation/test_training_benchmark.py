"""What the training benchmark compares with is still the same task."""

import sys
from pathlib import Path

import numpy as np

from mbot_workstation.sim.scene.room_generator import generate_room

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from training_environment import PlainEnv, kernels


def test_the_plain_environment_drives_straight_on() -> None:
    world = PlainEnv(generate_room(0, 256))
    before, _ = world.reset(seed=0)
    for _ in range(2):
        world.step(np.ones(2, np.float32))
    after, _, ended, _, _ = world.step(np.ones(2, np.float32))
    ahead_m, left_m = world.data.qpos[:2]
    assert ahead_m > 0.1
    assert abs(left_m) < 0.02
    assert not ended
    assert not np.array_equal(before, after)


def test_kernels_take_time() -> None:
    assert all(each_ms > 0 for each_ms in kernels(generate_room(0, 256), 4).values())
