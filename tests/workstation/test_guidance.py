import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive.actions import WheelMaps
from mbot_workstation.learn.learning.advice_memory import BURN_IN, AdviceMemory
from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.guidance import advice_loss, guide_weight
from mbot_workstation.learn.learning.learner import LearnerSettings, make_learner
from mbot_workstation.learn.learning.picture_ppo import PicturePPO
from mbot_workstation.learn.learning.sequences import Sequences
from mbot_workstation.learn.learning.views import Stills
from mbot_workstation.learn.worlds.rooms import evaluation_rooms
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.body_record import BODY_RECORD, body_record
from mbot_workstation.sim.effects.effects import RealWorldEffects
from mbot_workstation.sim.effects.presets import KNOWN, preset
from mbot_workstation.tasks.fetch.episode import FACTS
from mbot_workstation.tasks.fetch.guide import SEARCH_BEGINS, SEARCH_SPEED, FetchGuide
from mbot_workstation.tasks.fetch.oracle import Oracle, middle
from mbot_workstation.tasks.fetch.rules import TIME_LIMIT_DECISIONS
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.tasks.lesson import lesson_named

NOMINAL = preset("nominal")
SEARCH, BEGINS = (
    Oracle(1, middle(NOMINAL)).commands(np.array([speed]), np.array([-speed]))[0]
    for speed in (SEARCH_SPEED, SEARCH_BEGINS * SEARCH_SPEED)
)
"""What the wheels are told in a search turn, and in its first decision."""


def situation(
    ahead_m: float,
    left_m: float,
    seen_left_rad: float | None = None,
    time_left_s: float = 50,
) -> np.ndarray:
    if seen_left_rad is None:  # a robot that stands: it sees where the object is
        seen_left_rad = math.atan2(left_m, ahead_m - 0.06)
    record = np.zeros(1, FACTS)
    record["target_ahead_m"], record["target_left_m"] = ahead_m, left_m
    record["aim_ahead_m"], record["aim_left_m"] = ahead_m, left_m
    record["suspect_ahead_m"] = record["suspect_left_m"] = math.inf
    record["seen_left_rad"], record["time_left_s"] = seen_left_rad, time_left_s
    return record


def advice(ahead_m: float, left_m: float, seen_left_rad: float | None = None) -> np.ndarray:
    return FetchGuide(1, NOMINAL).act(situation(ahead_m, left_m, seen_left_rad))[0]


def told(advice: np.ndarray) -> np.ndarray:
    return within_full_speed(torch.from_numpy(advice)).numpy()


def test_a_turn_is_asked_for_on_top_of_full_speed() -> None:
    for left_m in (-2.0, -0.3, 0.0, 0.3):
        asked = advice(1.0, left_m, seen_left_rad=0.1)[None]
        assert asked.mean() == pytest.approx(1.0, abs=1e-6)
        left, right = told(asked)[0]
        assert max(left, right) == pytest.approx(1.0, abs=1e-6)
        assert right - left == pytest.approx(asked[0, 1] - asked[0, 0], abs=1e-6)


def test_what_the_camera_cannot_see_is_searched_clockwise() -> None:
    assert SEARCH[0] == pytest.approx(-SEARCH[1])
    assert SEARCH[0] > 0.2
    for ahead_m, left_m in ((-1.0, 0.1), (0.5, 1.0), (0.5, -1.0), (0.1, 0.5)):
        np.testing.assert_allclose(advice(ahead_m, left_m), BEGINS)


def test_a_search_turn_begins_faster_since_wheels_lag() -> None:
    guide = FetchGuide(1, NOMINAL)
    behind = situation(-1.0, 0.1)
    np.testing.assert_allclose(guide.act(behind)[0], BEGINS)
    for driven in (BEGINS, SEARCH, 0.8 * SEARCH):
        guide.drove(driven[None])
        np.testing.assert_allclose(guide.act(behind)[0], SEARCH)
    guide.drove(-SEARCH[None])  # to the left
    np.testing.assert_allclose(guide.act(behind)[0], BEGINS)
    assert BEGINS[0] > 1.2 * SEARCH[0]


def test_to_a_picture_of_the_object_before_there_is_no_advice() -> None:
    guide = FetchGuide(1, NOMINAL, remembers=2)
    guide.drove(told(guide.act(situation(0.2, 0.0, time_left_s=50))))
    assert np.isnan(guide.act(situation(-1.0, 0.5, math.nan, time_left_s=66))).all()
    guide.drove(np.array([[0.9, 1.0]], np.float32))
    np.testing.assert_allclose(guide.act(situation(-1.0, 0.5, time_left_s=65))[0], BEGINS)


def test_what_it_sees_is_driven_at() -> None:
    left, right = advice(2.0, 0.0)
    assert left == pytest.approx(right, abs=0.05)
    assert left > 0.9
    left, right = advice(1.0, 0.3)
    assert right > left > 0
    left, right = advice(1.0, -0.3)
    assert left > right > 0


def test_what_a_picture_shows_counts_though_the_robot_has_turned_past_it() -> None:
    left, right = advice(0.7, 0.7, seen_left_rad=0.4)
    assert right > left, "back to it, not once around"
    np.testing.assert_allclose(advice(1.0, 0.3, seen_left_rad=0.6), BEGINS)


def test_what_has_just_been_lost_is_gone_back_to_and_then_searched() -> None:
    guide = FetchGuide(1, NOMINAL, remembers=2)
    guide.drove(told(guide.act(situation(1.0, 0.3))))
    for _ in range(2):
        left, right = guide.act(situation(0.3, 1.0))[0]
        assert right > left
    np.testing.assert_allclose(guide.act(situation(0.3, 1.0))[0], BEGINS)


def test_who_forgets_searches_what_it_had_noticed() -> None:
    guide = FetchGuide(2, NOMINAL, remembers=2)
    guide.drove(told(guide.act(situation(1.0, 0.3).repeat(2))))
    guide.forget(np.array([True, False]))
    forgot, remembers = guide.act(situation(0.3, 1.0).repeat(2))
    np.testing.assert_allclose(forgot, BEGINS)
    assert remembers[1] > remembers[0]


def test_what_was_not_noticed_is_not_gone_back_to() -> None:
    """Who drives on searching has not seen it, whatever the picture shows."""
    guide = FetchGuide(1, NOMINAL, remembers=2)
    guide.act(situation(3.0, 0.3))
    guide.drove(SEARCH[None] + np.float32(0.1))
    np.testing.assert_allclose(guide.act(situation(1.0, 3.0))[0], SEARCH)


@pytest.mark.parametrize("time_left_s", [50, 66], ids=["the same object", "the next one"])
def test_to_have_noticed_it_once_does_not_count_for_ever(time_left_s: float) -> None:
    guide = FetchGuide(1, NOMINAL, remembers=1)
    guide.drove(told(guide.act(situation(1.0, 0.3, time_left_s=50))))
    for _ in range(2 if time_left_s == 50 else 0):
        guide.drove(told(guide.act(situation(0.3, 1.0, time_left_s=50))))
    guide.act(situation(3.0, 0.3, time_left_s=time_left_s))
    guide.drove(SEARCH[None])
    np.testing.assert_allclose(guide.act(situation(1.0, 3.0, time_left_s=time_left_s))[0], SEARCH)


def test_the_next_object_was_not_seen_before() -> None:
    guide = FetchGuide(1, NOMINAL, remembers=2)
    guide.drove(told(guide.act(situation(1.0, 0.3, time_left_s=50))))
    np.testing.assert_allclose(guide.act(situation(0.3, 1.0, time_left_s=66))[0], BEGINS)


def searched_in_vain() -> FetchGuide:
    """For as long as there is time for an object."""
    guide = FetchGuide(1, NOMINAL, remembers=2)
    for decision in range(TIME_LIMIT_DECISIONS):
        asked = guide.act(situation(-4.0, 0.0))
        np.testing.assert_allclose(asked[0], SEARCH if decision else BEGINS)
        guide.drove(told(asked))
    return guide


def test_a_search_ends_with_an_object_in_view() -> None:
    left, right = told(searched_in_vain().act(situation(2.0, -0.5)))[0]
    assert left > right, "to the object"


def test_who_stands_before_an_object_has_not_noticed_it() -> None:
    guide = FetchGuide(1, NOMINAL, remembers=2)
    guide.act(situation(2.0, 0.1))
    guide.drove(np.zeros((1, 2), np.float32))
    np.testing.assert_allclose(guide.act(situation(0.1, 2.0))[0], BEGINS)


@pytest.mark.slow
@pytest.mark.parametrize(("sight_m", "least", "most"), [(5.0, 15, 16), (2.8, 0, 8)])
def test_who_stays_where_it_is_needs_eyes_that_reach_across_the_arena(
    sight_m: float, least: int, most: int
) -> None:
    """Robots of all kinds: in how many of 16 episodes they fetch all ten objects."""
    ranges = preset("randomised")
    guide = FetchGuide(16, ranges, remembers=6)
    touched_all: list[bool] = []
    with TaskVecEnv(
        16, 0, ranges, lesson_named(TASK.lessons, "10"), evaluation_rooms([], 1)
    ) as environment:
        environment.reset()
        while len(touched_all) < 16:
            sight = environment.observations()
            seen = sight.situations.copy()
            distance_m = np.hypot(seen["target_ahead_m"], seen["target_left_m"])
            seen["seen_left_rad"][distance_m > sight_m] = math.pi
            guide.become(sight.bodies)
            actions = told(np.nan_to_num(guide.act(seen)))
            guide.drove(actions)
            _, _, ended, infos = environment.step(actions)
            touched_all += [infos[robot]["touches"] == 10 for robot in np.flatnonzero(ended)]
    assert least <= sum(touched_all) <= most


def test_without_a_target_there_is_no_advice() -> None:
    assert np.isnan(advice(math.nan, math.nan)).all()


def test_who_knows_of_a_weak_motor_drives_straight_with_it() -> None:
    """The stronger wheel is told less, so that both turn alike."""
    effects = RealWorldEffects(left_gain=0.5)
    guide = FetchGuide(1, preset("ideal"))
    guide.become(np.array([body_record(effects, RobotParameters())], BODY_RECORD))
    left, right = told(guide.act(situation(2.0, 0.0)))[0]
    assert left == pytest.approx(1.0, abs=0.01)
    assert right == pytest.approx(0.5, abs=0.05)
    left, right = guide.act(situation(-1.0, 0.0))[0]
    assert left == pytest.approx(-2 * right, rel=0.01)


def test_a_trim_is_a_weak_motor_to_a_body() -> None:
    maps = RobotParameters().wheel_maps
    weaker = WheelMaps(maps.left, msgspec.structs.replace(maps.right, trim=0.5))
    body = np.array(
        [body_record(RealWorldEffects(), replace(RobotParameters(), wheel_maps=weaker))],
        BODY_RECORD,
    )[0]
    assert body["left_gain"] == 1.0
    assert body["right_gain"] == pytest.approx(0.5)


@given(st.floats(-1, 1), st.floats(0.4, 1.1))
def test_the_oracle_knows_how_fast_its_commands_turn_a_wheel(speed: float, gain: float) -> None:
    oracle = Oracle(1, replace(KNOWN, left_gain=gain))
    speed *= gain
    if abs(speed) < 1e-3:
        return
    command = oracle.commands(np.array([speed]), np.array([0.0]))
    oracle.drove(command)
    assert oracle._last_turn[0] == pytest.approx(-speed, abs=1e-5)  # pyright: ignore[reportPrivateUsage]


def test_unknown_advice_costs_nothing_and_has_no_gradient() -> None:
    wheels = torch.tensor([[0.5, 0.5], [0.2, -0.2]], requires_grad=True)
    asked = torch.tensor([[math.nan, math.nan], [0.2, -0.19]])
    loss = advice_loss(wheels, asked)
    assert float(loss.detach()) == pytest.approx(1e-4, rel=1e-2)
    loss.backward()
    assert wheels.grad is not None
    assert wheels.grad[0].tolist() == [0.0, 0.0]
    assert torch.isfinite(wheels.grad).all()


@pytest.mark.parametrize("likelier", [0.3, 0.7])
def test_who_cannot_tell_does_the_likelier_and_not_the_mean(likelier: float) -> None:
    drive, search = torch.tensor([1.0, 1.0]), torch.tensor([0.3, -0.3])
    wheels = torch.zeros(1, 2, requires_grad=True)
    optimiser = torch.optim.Adam([wheels], lr=0.02)
    for _ in range(500):
        optimiser.zero_grad()
        told = ((likelier, drive), (1 - likelier, search))
        torch.stack(
            [share * advice_loss(wheels, asked[None]) for share, asked in told]
        ).sum().backward()
        optimiser.step()
    nearer = drive if likelier > 0.5 else search
    mean = likelier * drive + (1 - likelier) * search
    assert (wheels - nearer).norm() < 0.5 * (mean - nearer).norm()


@given(st.integers(0, 10**7), st.integers(0, 10**6))
def test_the_guides_weight_falls_to_nothing(decisions: int, guided: int) -> None:
    weight = guide_weight(decisions, guided)
    assert 0.0 <= weight <= 1.0
    assert (weight == 0.0) == (decisions >= guided)


def sequences(count: int, level: int, length: int = 12) -> Sequences:
    shape = (length, count)
    return Sequences(
        seen=np.full((*shape, 4, 4, 3), level, np.uint8),
        previous_actions=np.full((*shape, 2), level, np.float32),
        forgot=np.zeros(shape, np.float32),
        state=np.full((count, 5), level, np.float32),
        advice=np.full((*shape, 2), level / 10, np.float32),
        shows=np.ones(shape, np.bool_),
    )


def test_the_memory_keeps_the_newest_sequences_whole() -> None:
    memory = AdviceMemory(5 * 12)
    for level in (1, 2, 3):
        memory.add(sequences(2, level))
    assert len(memory) == 4 * 12, "no part of what is remembered is thrown away alone"
    batch = memory.draw(200 * 12)
    assert batch.seen.shape == (12, 200, 4, 4, 3)
    assert {int(level) for level in batch.seen[0, :, 0, 0, 0]} == {2, 3}
    levels = batch.seen[:, :, 0, 0, 0]
    np.testing.assert_allclose(batch.previous_actions[..., 0], levels)
    np.testing.assert_allclose(batch.state[:, 0], levels[0])
    np.testing.assert_allclose(batch.advice[BURN_IN:, :, 0], levels[BURN_IN:] / 10)
    assert np.isnan(batch.advice[:BURN_IN]).all(), "the state is in terms of older weights there"


def test_what_is_rehearsed_alone_is_mirrored_where_it_shows_an_object() -> None:
    """Four quarters of a robot's day: the object on the left and shown, remembered, sought, and no
    advice. In the picture one column tells left from right.
    """
    lived = sequences(3, 0, length=32)
    day = np.arange(32) // 8
    lived.seen[:, :, :, 0] = day[:, None, None, None] + 1
    lived.shows[:] = (day == 0)[:, None]
    quarters = np.array([[0.9, 1.1], [0.8, 1.2], [0.3, -0.3], [np.nan, np.nan]], np.float32)
    lived.advice[:] = quarters[day][:, None]
    memory = AdviceMemory(10**4)
    memory.add(replace(lived, state=np.ones((3, 5), np.float32)))
    alone = memory.draw_alone(2000)
    assert alone.seen.shape == (1, 2000, 4, 4, 3)
    assert alone.forgot.all()
    assert not alone.state.any()
    assert not alone.previous_actions.any()
    first, last = alone.seen[0, :, 0, 0, 0], alone.seen[0, :, 0, -1, 0]
    kinds = np.maximum(first, last) - 1
    for kind, share in ((0, 1 / 8), (1, 1 / 4), (2, 1 / 4), (3, 1 / 4)):
        as_seen = (kinds == kind) & (first > 0)
        assert as_seen.mean() == pytest.approx(share, abs=0.04)
        expected = np.full(2, np.nan) if kind == 1 else quarters[kind]
        np.testing.assert_allclose(alone.advice[0][as_seen], np.tile(expected, (as_seen.sum(), 1)))
    mirrored = last > 0
    assert set(kinds[mirrored]) == {0}
    assert mirrored.mean() == pytest.approx(1 / 8, abs=0.04)
    np.testing.assert_allclose(
        alone.advice[0][mirrored], np.tile(quarters[0][::-1], (mirrored.sum(), 1))
    )


def test_parts_are_side_by_side() -> None:
    both = sequences(3, 1)
    parts = [both.part(index, 2) for index in range(2)]
    assert [part.forgot.shape for part in parts] == [(12, 2), (12, 1)]
    assert [part.state.shape for part in parts] == [(2, 5), (1, 5)]
    assert sum(part.decisions for part in parts) == both.decisions


@pytest.mark.slow
def rehearses_stills(learner: PicturePPO, number: int) -> bool:
    """Whether this one of its rehearsals is of stills, if it has any."""
    features, advice = np.full((4, 256), 7, np.float32), np.zeros((4, 2), np.float32)
    learner.stills = Stills(features, advice, learner.policy.units)
    drawn = learner._rehearsal(number)  # pyright: ignore[reportPrivateUsage]
    learner.stills = None
    return drawn.seen.ndim == 3 and bool((drawn.seen == 7).all())


def test_rehearsing_moves_the_wheels_and_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = LearnerSettings(
        steps_per_robot=16,
        batch=16,
        epochs=1,
        guided_decisions=10**6,
        rehearsals=3,
        learning_rate=1e-9,  # PPO's own steps change nothing that could be seen
        final_learning_rate=1e-9,
    )
    with TaskVecEnv(robots=1, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(
            environment, lambda robots: FetchGuide(robots, preset("ideal"))
        )
        learner.learn(16)
        before = {k: v.clone() for k, v in learner.policy.state_dict().items()}
        for group in learner.policy.optimizer.param_groups:
            group["lr"] = 1e-2
        alone: list[int] = []
        draw_alone = AdviceMemory.draw_alone

        def noted(memory: AdviceMemory, decisions: int) -> Sequences:
            alone.append(decisions)
            return draw_alone(memory, decisions)

        monkeypatch.setattr(AdviceMemory, "draw_alone", noted)
        with ThreadPoolExecutor(2) as threads:
            learner._rehearse(threads)  # pyright: ignore[reportPrivateUsage]
        after = learner.policy.state_dict()
    assert alone == [learner.rehearsal_batch], "the first of eight"
    with_stills = [number for number in range(8) if rehearses_stills(learner, number)]
    assert with_stills == [0, 2, 4, 6], "half of them, of an eye that learns no more"
    assert not torch.equal(before["action_net.bias"], after["action_net.bias"])
    assert not torch.equal(before["memory.bias_hh"], after["memory.bias_hh"])
    assert "_memory" in learner._excluded_save_params()  # pyright: ignore[reportPrivateUsage]


@pytest.mark.slow
def test_fewer_epochs_while_the_guide_counts_for_more_than_half() -> None:
    settings = LearnerSettings(
        steps_per_robot=16, batch=16, epochs=3, guided_decisions=64, guided_epochs=1
    )
    with TaskVecEnv(robots=1, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(
            environment, lambda robots: FetchGuide(robots, preset("ideal"))
        )
        learner.learn(16)  # its weight is 3/4
        updates = [learner._n_updates]  # pyright: ignore[reportPrivateUsage]
        learner.learn(16, reset_num_timesteps=False)  # 1/2
        updates.append(learner._n_updates)  # pyright: ignore[reportPrivateUsage]
    assert updates == [1, 1 + 3]


def test_who_sees_nothing_else_goes_and_looks_at_what_may_be_the_object() -> None:
    guide = FetchGuide(1, NOMINAL)
    record = situation(-1.0, 0.0, math.pi)
    record["suspect_ahead_m"], record["suspect_left_m"] = 2.0, 0.0
    assert guide.shows(record).all()
    left, right = told(guide.act(record))[0]
    assert min(left, right) > 0.9, "straight ahead"
    record["suspect_ahead_m"] = math.inf
    assert not guide.shows(record).any()
    np.testing.assert_allclose(guide.act(record)[0], BEGINS, atol=1e-6)


def test_the_object_itself_comes_first() -> None:
    both = situation(1.0, 0.3)
    alone = FetchGuide(1, NOMINAL).act(both)[0]
    both["suspect_ahead_m"], both["suspect_left_m"] = 2.0, -0.5
    np.testing.assert_array_equal(FetchGuide(1, NOMINAL).act(both)[0], alone)
