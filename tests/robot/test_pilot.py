"""A policy's memory: kept from one driven decision to the next, zeroed by anything between them."""

from collections.abc import Callable

import numpy as np
import pytest

from mbot_agent.faults import Fault
from mbot_agent.models.pilot import Pilot
from mbot_agent.models.trial import Finding, Trial
from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy import Answer, Policy, PolicyError
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView, Memory, PolicyMetadata

from .loop_bench import Bench
from .tiny_models import constant_model, counting_model

PICTURE: Picture = np.full((64, 64, 3), 90, np.uint8)


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


DUE_NS = 2**62
"""In time, whenever it is."""


class Asked:
    """A pilot with nothing around it, and what becomes of its model's trial.

    Attributes:
        times: how often its model was asked.
        findings: of the trial.

    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, clean_decisions: int | None = None) -> None:
        self.pilot = Pilot()
        self.times = 0
        self.findings: list[Finding] = []
        self._patch = monkeypatch
        self.takes(counting_model(), clean_decisions)

    def takes(self, data: bytes, clean_decisions: int | None = None) -> None:
        policy = Policy(data)
        whole = policy.decide

        def decide(observation: Picture, memory: Memory) -> Answer:
            self.times += 1
            return whole(observation, memory)

        self._patch.setattr(policy, "decide", decide)
        trial = None
        if clean_decisions is not None:
            trial = Trial(policy.sha256, clean_decisions, lambda v: self.findings.append(v.finding))
        self.pilot.use(policy, trial)
        self.pilot.change_over()

    def breaks(self) -> None:
        """As often as it is believed."""

        def fail(*_: object) -> Answer:
            raise PolicyError("nonsense")

        assert self.pilot.policy is not None
        with self._patch.context() as patch:
            patch.setattr(self.pilot.policy, "decide", fail)
            for _ in range(3):
                self.pilot.decide(PICTURE, DUE_NS)


def test_without_a_model_it_says_so_and_asks_nobody() -> None:
    pilot = Pilot()
    assert (pilot.sha256, pilot.view) == ("", FULL_VIEW)
    assert pilot.fault is not None
    assert pilot.fault.kind == "no-model"
    pilot.rehearse(PICTURE, DUE_NS)
    policy = Policy(
        constant_model(metadata=PolicyMetadata("wide", view=FieldOfView(90, 60)).to_properties())
    )
    pilot.use(policy)
    assert pilot.fault is None, "one has come, and is taken up at the next beat"
    pilot.change_over()
    assert (pilot.sha256, pilot.view) == (policy.sha256, policy.metadata.view)
    assert pilot.view != FULL_VIEW
    assert pilot.fault is None


def test_only_a_model_on_trial_is_asked_while_nobody_needs_its_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    proven = Asked(monkeypatch)
    proven.pilot.rehearse(PICTURE, DUE_NS)
    assert proven.times == 0
    tried = Asked(monkeypatch, 2)
    for _ in range(5):
        tried.pilot.rehearse(PICTURE, DUE_NS)
    assert (tried.times, tried.findings) == (2, [Finding.PROVEN])


def test_without_a_picture_or_in_time_nothing_is_proven_but_that_the_daemon_lives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    blind, slow = Asked(monkeypatch, 2), Asked(monkeypatch, 2)
    for _ in range(3):
        blind.pilot.rehearse(None, DUE_NS)
        slow.pilot.decide(PICTURE, 0)
    assert (blind.times, blind.findings) == (0, [Finding.SURVIVED])
    assert (slow.times, slow.findings) == (3, [Finding.SURVIVED])


def test_a_model_that_is_given_up_is_asked_no_more_and_the_next_one_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = Asked(monkeypatch, 2)
    asked.breaks()
    assert asked.pilot.has_given_up
    assert asked.pilot.fault is not None
    assert asked.pilot.fault.kind == "model-failed"
    asked.pilot.rehearse(PICTURE, DUE_NS)
    assert asked.times == 0
    asked.takes(counting_model("another"), 2)
    assert (asked.pilot.has_given_up, asked.pilot.fault) == (False, None)
    asked.pilot.rehearse(PICTURE, DUE_NS)
    assert asked.times == 1
