import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.evaluation import evaluate_policy

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.worlds.segment import SegmentPlan
from mbot_workstation.learn.worlds.shared_arrays import SEGMENT, SLOTS
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.learn.worlds.worker_pool import WorkerError, WorkerGoneError
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.oracle import Oracle, middle
from mbot_workstation.tasks.fetch.rules import DECISION_S, TIME_LIMIT_DECISIONS

from ..ran import ran
from .scripted_pilot import MistakenPilot, ScriptedPilot, wheels_as_plan
from .small_world import ROOMS

ROBOTS = 3


@pytest.fixture(scope="module")
def pair() -> Iterator[TaskVecEnv]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parents[2])  # where workers find ScriptedPilot
        environment = TaskVecEnv(ROBOTS, 5, "randomised", "1", ROOMS, workers=2)
    with environment:
        yield environment


def actions(steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, ROBOTS, 2)).astype(np.float32)


def run(environment: TaskVecEnv, seed: int, steps: int = 15) -> list[np.ndarray]:
    environment.seed(seed)
    seen = [environment.reset()]
    for action in actions(steps):
        observations, rewards, ended, _ = environment.step(action)
        seen += [observations, rewards, ended]
    return seen


def assert_same_info(found: dict[str, Any], expected: dict[str, Any]) -> None:
    """Numbers come through shared memory as 32 bit."""
    for key, value in expected.items():
        if isinstance(value, str):
            assert found[key] == value, key
        else:
            near = pytest.approx(value, rel=1e-5, abs=1e-6, nan_ok=True)
            assert found[key] == near, key


@pytest.mark.slow
def test_every_robot_is_the_single_environment_bit_for_bit(pair: TaskVecEnv) -> None:
    singles = [TaskEnv("randomised", "1", ROOMS) for _ in range(ROBOTS)]
    pair.seed(5)
    observations = pair.reset()
    for row, single in enumerate(singles):
        first, info = single.reset(seed=5 + row)
        assert np.array_equal(first, observations[row])
        assert_same_info(pair.reset_infos[row], info)
    episodes = 0
    for action in actions(200):  # 167 decisions are an episode at least
        observations, rewards, ended, infos = pair.step(action)
        for row, single in enumerate(singles):
            expected, reward, is_over, _, info = single.step(action[row])
            assert rewards[row] == pytest.approx(reward)
            assert ended[row] == is_over
            assert_same_info(infos[row], info)
            if is_over:
                episodes += 1
                assert np.array_equal(infos[row]["terminal_observation"], expected)
                expected, info = single.reset()
                assert_same_info(pair.reset_infos[row], info)
            assert np.array_equal(np.asarray(observations)[row], expected)
    assert episodes >= ROBOTS
    for single in singles:
        single.close()


def test_the_number_of_workers_changes_nothing(pair: TaskVecEnv) -> None:
    both = run(pair, seed=9)
    with TaskVecEnv(ROBOTS, 9, "randomised", "1", ROOMS, workers=1) as alone:
        assert all(np.array_equal(a, b) for a, b in zip(both, run(alone, 9), strict=True))


def plans(environment: TaskVecEnv, told: np.ndarray) -> list[SegmentPlan]:
    """Each worker's part of what robots are told, shape (decisions, robots, 2)."""
    return [wheels_as_plan(told[:, share.start : share.stop]) for share in environment.shares]


@pytest.mark.slow
def test_pilots_drive_as_everybody_does(pair: TaskVecEnv) -> None:
    """In segments, of which two are under way at once, as decision by decision."""
    steps = 200  # 167 decisions are an episode at least
    together = run(pair, seed=4, steps=steps)
    pair.seed(4)
    pair.reset()
    assert pair.shares == [range(2), range(2, 3)]
    pair.set_pilot(ScriptedPilot())
    told = actions(steps)
    parts = [told[start : start + SEGMENT] for start in range(0, steps, SEGMENT)]
    pair.drive(len(parts[0]), plans(pair, parts[0]))
    seen, rewards, ends, infos, situations = [], [], [], [], []
    for part, following in pairwise([*parts, told[:0]]):
        if len(following):
            pair.drive(len(following), plans(pair, following))
        segment = pair.arrive()
        assert len(segment.rewards) == len(part)
        assert (segment.decisions.states != os.getpid()).all()
        assert np.array_equal(segment.pictures, segment.decisions.known)
        assert np.array_equal(segment.ended, segment.decisions.forgot)
        seen.append(segment.pictures.copy())
        rewards.append(segment.rewards)
        ends.append(segment.ended)
        infos += [info for some in segment.infos for info in some]
        situations.append(segment.situations)
    ended = np.concatenate(ends)
    np.testing.assert_array_equal([together[0], *together[1::3]][:steps], np.concatenate(seen))
    np.testing.assert_array_equal(together[-3], pair.observations().pictures)
    np.testing.assert_array_equal(together[2::3], np.concatenate(rewards))
    np.testing.assert_array_equal(together[3::3], ended)
    assert len(infos) == ended.sum() > 0
    assert {info["episode"]["l"] for info in infos} >= set((np.argmax(ended, axis=0) + 1).tolist())
    left_s = np.concatenate(situations)["time_left_s"]
    began = np.concatenate([np.ones((1, ROBOTS), bool), ended[:-1]])
    assert (left_s[began] == left_s.max()).all(), "an episode begins with all its time"


def test_a_lesson_may_be_given_while_robots_drive(pair: TaskVecEnv) -> None:
    pair.reset()
    pair.set_pilot(ScriptedPilot())
    pair.drive(1, plans(pair, actions(1)))
    pair.set_lesson("2")
    pair.drive(2, plans(pair, actions(2)))
    pair.set_lesson("1")
    assert pair.arrive().rewards.shape == (1, ROBOTS)
    pair.halt()
    assert np.array(pair.step(actions(1)[0])[0]).std() > 0


def test_what_is_still_driven_is_forgotten_by_who_does_not_ask_for_it(pair: TaskVecEnv) -> None:
    told = actions(1)
    pair.set_pilot(ScriptedPilot())
    for go_on in (pair.reset, lambda: pair.step(told[0])):
        for _ in range(SLOTS):
            pair.drive(1, plans(pair, told))
        with pytest.raises(RuntimeError, match="2 segments are being driven already"):
            pair.drive(1, plans(pair, told))
        go_on()
        pair.drive(1, plans(pair, told))
        assert pair.arrive().rewards.shape == (1, ROBOTS)


def test_nobody_drives_without_a_pilot() -> None:
    with TaskVecEnv(1, 0, "ideal", "1", ROOMS, workers=1) as environment:
        environment.reset()
        environment.drive(1, plans(environment, np.zeros((1, 1, 2), np.float32)))
        with pytest.raises(WorkerError, match="there is no pilot"):
            environment.arrive()


def test_observations_are_the_callers_to_keep(pair: TaskVecEnv) -> None:
    before = pair.reset()
    kept = before.copy()
    pair.step(actions(1)[0])
    assert np.array_equal(before, kept)


def test_episodes_are_summed_up_when_they_end(pair: TaskVecEnv) -> None:
    pair.reset()
    returns, lengths, ends = np.zeros(ROBOTS), np.zeros(ROBOTS, int), 0
    for _ in range(45):
        _, rewards, ended, infos = pair.step(np.ones((ROBOTS, 2), np.float32))
        returns += rewards
        lengths += 1
        for row in range(ROBOTS):
            assert ("episode" in infos[row]) == bool(ended[row])
            assert ("terminal_observation" in infos[row]) == bool(ended[row])
            if ended[row]:
                ends += 1
                episode = infos[row]["episode"]
                assert episode["r"] == pytest.approx(returns[row], abs=1e-5)
                assert episode["l"] == lengths[row]
                returns[row] = lengths[row] = 0
    assert ends >= ROBOTS


def test_a_lesson_begins_with_the_next_episode() -> None:
    with TaskVecEnv(2, 0, "ideal", "1", ROOMS, workers=1) as environment:
        environment.reset()
        environment.set_lesson("10")
        names, ended = [], np.zeros(2, bool)
        forward = np.ones((2, 2), np.float32)
        for _ in range(30):
            _, _, ended, infos = environment.step(forward)
            names.append((infos[0]["lesson"], bool(ended[0])))
        switch = [name for name, _ in names].index("10")
        assert names[switch - 1] == ("1", True)
        assert all(b == "10" for (a, _), (b, _) in pairwise(names) if a == "10")
        assert environment.lesson.name == "10"


@pytest.mark.slow
def test_stable_baselines_evaluates_a_policy_on_it(pair: TaskVecEnv) -> None:
    class Ahead:
        def predict(self, observation: np.ndarray, **_: object) -> tuple[np.ndarray, None]:
            return np.ones((len(observation), 2), np.float32), None

    returns, lengths = evaluate_policy(
        Ahead(),  # pyright: ignore[reportArgumentType]
        pair,
        n_eval_episodes=4,
        return_episode_rewards=True,
        warn=True,
    )
    assert len(returns) == len(lengths) == 4  # pyright: ignore[reportArgumentType]


def test_a_killed_worker_is_named() -> None:
    with TaskVecEnv(2, 0, "ideal", "1", ROOMS, workers=2) as environment:
        environment.reset()
        victim = next(c for c in multiprocessing.active_children() if c.name == "robots 1 to 1")
        victim.kill()
        victim.join()
        with pytest.raises(WorkerGoneError, match=r"robots 1 to 1 .*-9"):
            environment.step(np.zeros((2, 2), np.float32))


def test_a_picture_of_the_object_before_says_nothing_of_the_next_one() -> None:
    """Pictures are 300 ms old: until then after a touch they show what was touched."""
    age_s = 0.3
    ranges = preset("ideal").changed(camera_latency_ms=(1000 * age_s, 1000 * age_s))
    oracle, told = Oracle(1, middle(ranges)), []
    with TaskVecEnv(1, 0, ranges, "10", ROOMS, workers=1) as environment:
        environment.reset()
        for _ in range(150):
            (now,) = environment.observations().situations
            target = np.array([[now["target_ahead_m"], now["target_left_m"]]], np.float64)
            environment.step(oracle.act(target))
            (now,) = environment.observations().situations
            for_s = TIME_LIMIT_DECISIONS * DECISION_S - now["time_left_s"]
            if 0.01 < for_s < DECISION_S:
                told.append(for_s)
                assert np.isnan(now["seen_left_rad"]) == (for_s < age_s)
    assert min(told) < age_s < max(told), "both kinds of touches were there"


def test_drivers_are_told_of_a_robot_that_changes_on_the_way() -> None:
    weak = (("left_gain", (0.5, 0.5)),)
    swap = FetchLesson("swap", 2.5, objects=10, changes=1.0, change_after=(2, 3), change_to=weak)
    with TaskVecEnv(2, 0, "ideal", swap, ROOMS, workers=1) as environment:
        environment.reset()
        told = [environment.observations().bodies["left_gain"].tolist()]
        for _ in range(3):
            environment.step(np.zeros((2, 2), np.float32))
            told.append(environment.observations().bodies["left_gain"].tolist())
    assert told == [[1.0, 1.0]] * 3 + [[0.5, 0.5]]


def test_pictures_may_become_late_on_the_way() -> None:
    late = (("camera_latency_ms", (300.0, 300.0)),)
    swap = FetchLesson("swap", 2.5, objects=10, changes=1.0, change_after=(2, 3), change_to=late)
    environment = TaskEnv("ideal", swap, ROOMS)
    environment.reset(seed=0)
    ages_s: list[float] = []
    for decisions in range(1, 6):
        environment.step(np.zeros(2, np.float32))
        ages_s.append(decisions * DECISION_S - environment.world.glimpse.time_s)
    environment.close()
    assert ages_s[:2] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert ages_s[3:] == pytest.approx([0.3, 0.3], abs=1e-6)


@pytest.mark.slow
def test_workers_that_die_before_they_are_told_anything_are_named(tmp_path: Path) -> None:
    """A script without `if __name__ == "__main__"` is run again by each of them, and ends them."""
    script = tmp_path / "train.py"
    script.write_text(
        "from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv\n"
        "from mbot_workstation.learn.worlds.rooms import evaluation_rooms\n"
        "TaskVecEnv(2, rooms=evaluation_rooms([]), workers=2)\n"
    )
    done = ran(sys.executable, str(script))
    assert done.returncode == 1
    assert "WorkerGoneError: the worker of robots 0 to 0 has gone" in done.stderr


def test_a_failing_worker_sends_its_traceback() -> None:
    with TaskVecEnv(1, 0, "ideal", "1", ROOMS, workers=1) as environment:
        environment.reset()
        with pytest.raises(WorkerError, match=r"(?s)to_steps.*finite"):
            environment.step(np.full((1, 2), np.nan, np.float32))


def test_what_a_person_can_mend_comes_out_of_a_worker_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[2])
    with TaskVecEnv(1, 0, "ideal", "1", ROOMS, workers=1) as environment:
        environment.reset()
        environment.set_pilot(MistakenPilot())
        environment.drive(1, plans(environment, np.zeros((1, 1, 2), np.float32)))
        with pytest.raises(ConfigurationError, match=r"^the policy was deleted$"):
            environment.arrive()


def test_no_process_is_left(pair: TaskVecEnv) -> None:
    before = {child.pid for child in multiprocessing.active_children()}
    environment = TaskVecEnv(2, 0, "ideal", "1", ROOMS, workers=2)
    started = {child.pid for child in multiprocessing.active_children()} - before
    assert len(started) == 2
    environment.close()
    environment.close()
    assert {child.pid for child in multiprocessing.active_children()} == before
    assert not any(os.path.exists(f"/proc/{pid}") for pid in started)  # noqa: PTH110


INTERRUPTED = """
import multiprocessing, os, signal, sys
import numpy as np
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.tasks.fetch.lessons import FetchLesson

if __name__ == "__main__":
    room = np.zeros((32, 64, 3), np.uint8)
    environment = TaskVecEnv(2, 0, "ideal", "1", [room], workers=2)
    environment.reset()
    try:
        print(*(child.pid for child in multiprocessing.active_children()), flush=True)
        while True:
            environment.step(np.zeros((2, 2), np.float32))
    except KeyboardInterrupt:
        environment.step(np.zeros((2, 2), np.float32))  # workers have not been interrupted
        environment.close()
        print("closed", flush=True)
"""


@pytest.mark.slow
def test_ctrl_c_reaches_only_the_one_who_trains(tmp_path) -> None:
    script = tmp_path / "train.py"
    script.write_text(INTERRUPTED)
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        workers = process.stdout.readline().split()
        assert len(workers) == 2
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        assert process.stdout.readline() == "closed\n"
        assert process.wait(20) == 0
    assert not any(os.path.exists(f"/proc/{pid}") for pid in workers)  # noqa: PTH110


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="robots"):
        TaskVecEnv(0)
    with pytest.raises(ValueError, match="foggy"):
        TaskVecEnv(1, preset="foggy", rooms=ROOMS)
