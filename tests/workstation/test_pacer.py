import threading
import time

import numpy as np
import pytest

from mbot_workstation.pacer import Pacer
from mbot_workstation.sim.simulation import SceneState
from mbot_workstation.virtual.scene_history import SceneHistory


def test_ticks_keep_to_the_clock_without_drift() -> None:
    start_s = time.monotonic()
    pacer = Pacer(0.005, most_at_once=10_000)
    never = threading.Event()
    ticks = sum(pacer.wait(never) for _ in range(40))
    # However late the machine was: as many ticks as periods have passed.
    elapsed = (time.monotonic() - start_s) / 0.005
    assert ticks >= 40
    assert ticks <= elapsed


def test_a_stall_gives_no_burst() -> None:
    pacer = Pacer(0.001, most_at_once=5)
    never = threading.Event()
    time.sleep(0.05)
    assert pacer.wait(never) == 5
    assert pacer.lost >= 40


def test_stopping_ends_the_wait() -> None:
    stop = threading.Event()
    stop.set()
    assert Pacer(1000, 1).wait(stop) == 0


def moment(number: int, yaw_rad: float = 0.0) -> SceneState:
    joints = np.array([float(number), 0, 0, np.cos(yaw_rad / 2), 0, 0, np.sin(yaw_rad / 2)])
    return SceneState(joints, np.zeros((3, 3)), np.zeros((3, 4)))


def test_a_glance_finds_the_moment_and_how_fast_the_robot_turned() -> None:
    history = SceneHistory(slice_s=0.005)
    for number in range(100):
        history.add(number * 0.005, moment(number, yaw_rad=3.0 + 2.0 * number * 0.005))
    assert history.newest().joints[0] == 99
    state, turn_rate = history.glance(0.020)
    assert state.joints[0] == 95
    assert turn_rate == pytest.approx(2.0)


def test_a_young_history_gives_what_it_has() -> None:
    history = SceneHistory(slice_s=0.005)
    history.add(0.0, moment(1))
    state, turn_rate = history.glance(0.020)
    assert (state.joints[0], turn_rate) == (1, 0.0)
