"""A policy's memory: kept from one driven decision to the next, zeroed by anything between them."""

from collections.abc import Callable

import pytest

from mbot_agent.faults import Fault
from mbot_agent.models.policy import Answer, Policy, PolicyError
from mbot_agent.models.trial import Trial

from .loop_bench import Bench
from .tiny_models import constant_model, counting_model


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.pilot.use(Policy(counting_model()))
    made.run()
    return made


def remembered(bench: Bench) -> float:
    """Decisions that the policy remembers in the next one."""
    tick = bench.tick()
    assert tick.action is not None
    return tick.action.left * 8


def test_it_remembers_from_decision_to_decision_what_the_wheels_were_told(bench: Bench) -> None:
    answers = [bench.tick().action for _ in range(12)]
    assert [answer.left for answer in answers if answer] == [n / 8 for n in range(12)]
    # A wheel has 250 steps, and beyond 1 it is told 1.
    told = [0.0, *(min(round(n / 8 * 250) / 250, 1.0) for n in range(11))]
    assert [answer.right for answer in answers if answer] == pytest.approx(told)


def stop_and_run(bench: Bench) -> None:
    bench.helm.stop()
    bench.tick()
    bench.run()


def stop_and_run_between_two_beats(bench: Bench) -> None:
    bench.helm.stop()
    bench.run()


def another_model(bench: Bench) -> None:
    bench.pilot.use(Policy(counting_model("another")))


def camera_gap(bench: Bench) -> None:
    bench.camera.fault = Fault("gone", "for a moment")
    bench.tick()
    bench.camera.fault = None


def board_gap(bench: Bench) -> None:
    bench.board.fault = Fault("gone", "for a moment")
    bench.tick()
    bench.board.fault = None


def missed_decision(bench: Bench) -> None:
    bench.loop._metronome.missed += 1  # pyright: ignore[reportPrivateUsage]


def lost_acknowledgement(bench: Bench) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench.board, "delivery", lambda *_: None)
        bench.tick()


def failed_inference(bench: Bench) -> None:
    def fail(*_: object) -> Answer:
        raise PolicyError("not this one")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench.pilot.policy, "decide", fail)
        bench.tick()


BREAKS: list[Callable[[Bench], None]] = [
    stop_and_run,
    stop_and_run_between_two_beats,
    another_model,
    camera_gap,
    board_gap,
    missed_decision,
    lost_acknowledgement,
    failed_inference,
]


@pytest.mark.parametrize("broken", BREAKS, ids=lambda broken: broken.__name__)
def test_whatever_comes_between_two_decisions_zeroes_it(
    bench: Bench, broken: Callable[[Bench], None]
) -> None:
    for _ in range(3):
        bench.tick()
    broken(bench)
    assert [remembered(bench) for _ in range(3)] == [0, 1, 2]


def test_a_model_on_trial_remembers_nothing_of_what_it_said_while_the_robot_stood() -> None:
    bench = Bench()
    policy = Policy(counting_model())
    bench.pilot.use(policy, Trial(policy.sha256, 100, lambda _: None))
    for _ in range(3):
        bench.tick()
    bench.run()
    assert remembered(bench) == 0


def test_a_model_without_memory_goes_the_same_way() -> None:
    bench = Bench()
    bench.pilot.use(Policy(constant_model(0.5, -0.5)))
    bench.run()
    answers = [bench.tick().action for _ in range(2)]
    assert [(a.left, a.right) for a in answers if a] == [(0.5, -0.5)] * 2
