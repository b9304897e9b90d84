"""What the policy would have done while a person drives: recorded, and nothing else."""

import time
from typing import Any

import pytest

from mbot_agent.arming import Mark, Mode
from mbot_agent.helm import MARKED_WITHIN_NS, Press
from mbot_agent.models.trial import Trial, Verdict
from mbot_agent.network.wire_messages import beat_of
from mbot_agent.tick import Tick
from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.fields import decision_fields, drive_numbers
from mbot_protocol.drive.actions import AS_BUILT, Steps
from mbot_protocol.drive.wheel_command import Duties
from mbot_protocol.errors import RefusedError
from mbot_protocol.policy.policy import Policy, PolicyError

from .loop_bench import Bench
from .tiny_models import constant_model, counting_model

HAND = Press(sender=7, number=1, name="anna@desk")
TOLD = AS_BUILT.duties(Steps(50, -100))


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.pilot.use(Policy(counting_model()))
    return bench


def hold(bench: Bench, press: Press = HAND, duties: Duties = TOLD) -> None:
    bench.helm.steer_by_hand(duties, time.monotonic_ns() + 10**9, bench.stops, press)


def beat(tick: Tick) -> Beat:
    return beat_of(tick, "mbot-1", 42, (), AS_BUILT)


def test_a_beat_of_a_hand_says_who_drove_what_and_what_the_policy_would_have(
    bench: Bench,
) -> None:
    hold(bench)
    told = beat(bench.tick())
    decision = told.decision
    assert (decision.driven_by, decision.held_ms) == ("anna@desk", 0)
    assert told.at_wheels(AS_BUILT) == (0.2, -0.4)
    assert decision.HasField("would_have_done")
    assert not told.decided
    assert not decision.HasField("steps")
    assert decision.decided_monotonic_ns == 0
    numbers = drive_numbers(decision, told.policy_input)
    assert "would_have_done_left" in numbers
    assert not {"action_left", "steps_left", "decide_ms"} & numbers.keys()
    assert decision_fields(decision)["driven_by"] == "anna@desk"


def test_it_goes_on_from_what_the_hand_did(bench: Bench) -> None:
    hold(bench)
    first, second = beat(bench.tick()), beat(bench.tick())
    assert first.policy_input is not None
    assert second.policy_input is not None
    assert first.policy_input.began_anew
    assert not second.policy_input.began_anew
    assert second.told == (0.2, -0.4)
    assert second.policy_input.memory


def test_no_answer_beside_a_hand_reaches_a_motor_or_a_decision(bench: Bench) -> None:
    bench.run()
    alone = bench.tick()
    hold(bench)
    for _ in range(3):
        assert bench.tick().would_have_done is not None
    assert [c.duties for c in bench.board.commands[1:]] == [TOLD]
    bench.run()
    again = bench.tick()
    assert again.memory is None, "it starts over"
    assert again.action == alone.action
    assert again.would_have_done is None
    assert beat(again).decision.driven_by == ""


@pytest.mark.parametrize("how", ["fails", "is late"])
def test_one_that_is_a_burden_is_not_asked_again_and_nothing_is_held_against_it(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    asked, policy = [], Policy(constant_model(0.5, 0.5))
    answered = policy.decide(bench.camera.picture[:64, :64], policy.blank)
    verdicts: list[Verdict] = []
    bench.pilot.use(policy, Trial("abc", 0, verdicts.append))
    now_ns = time.monotonic_ns()

    def decide(*_: Any) -> Any:
        nonlocal now_ns
        asked.append(now_ns)
        if how == "fails":
            raise PolicyError("nonsense")
        now_ns += 500_000_000
        return answered

    hold(bench, duties=TOLD)
    monkeypatch.setattr(policy, "decide", decide)
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    for _ in range(5):
        assert bench.tick().faults == ()
    assert len(asked) == 1
    assert verdicts == []
    assert bench.pilot.fault is None
    bench.pilot.use(Policy(constant_model(0.5, 0.5)))
    assert bench.tick().would_have_done is not None, "another one is"


def test_a_picture_that_is_not_of_now_is_not_shown_to_it(bench: Bench) -> None:
    hold(bench)
    bench.camera.fresh = False
    assert bench.tick().would_have_done is None


def test_a_hand_that_takes_over_from_a_hand_is_another_driver(bench: Bench) -> None:
    hold(bench)
    bench.tick()
    hold(bench, Press(8, 1, "max"))
    tick = bench.tick()
    assert tick.driver is not None
    assert tick.driver.name == "max"
    assert tick.driver.since_ns > bench.loop.latest.orders.given_ns  # type: ignore[union-attr]


def test_a_mark_is_with_one_beat_and_moves_nothing(bench: Bench) -> None:
    bench.run()
    bench.tick()
    orders, asked = bench.helm.orders, list(bench.board.asked)
    bench.helm.mark(Mark("max", 3000))
    assert (bench.helm.orders, bench.board.asked) == (orders, asked)
    marked, after = beat(bench.tick()).decision, beat(bench.tick()).decision
    assert (marked.wrong_ms, marked.wrong_says) == (3000, "max")
    assert not after.HasField("wrong_ms")
    assert drive_numbers(marked)["wrong_ms"] == 3000
    assert "wrong_ms" not in drive_numbers(after)


def test_a_mark_counts_while_there_is_a_recording(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RefusedError, match="recording has ended"):
        bench.helm.mark(Mark("max", 3000))
    bench.run()
    now_ns = time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    bench.helm.stop("anna")
    now_ns += MARKED_WITHIN_NS
    bench.helm.mark(Mark("max", 3000))
    assert bench.helm.take_mark() == Mark("max", 3000)
    now_ns += 1
    with pytest.raises(RefusedError, match="recording has ended"):
        bench.helm.mark(Mark("max", 3000))
    assert bench.helm.orders.mode is Mode.STOPPED
