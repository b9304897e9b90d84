import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mbot_agent import control_loop
from mbot_agent.arming import Mode, State
from mbot_agent.configuration import Control
from mbot_agent.faults import Fault
from mbot_agent.helm import Press
from mbot_agent.models.trial import Finding, Trial, Verdict
from mbot_agent.tick import Tick
from mbot_protocol.drive.actions import Steps
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import STOP, Duties
from mbot_protocol.policy.policy import Answer, Policy
from mbot_protocol.policy.policy_contract import FULL_VIEW, FieldOfView, Memory, PolicyMetadata

from ..promised import promised
from .loop_bench import HAND, Bench
from .tiny_models import constant_model, counting_model


@pytest.fixture
def bench() -> Bench:
    return Bench()


class Clock:
    """Time that passes as the test says."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._ahead_ns = 0
        monotonic_ns = time.monotonic_ns
        monkeypatch.setattr(time, "monotonic_ns", lambda: monotonic_ns() + self._ahead_ns)

    def advance(self, seconds: float) -> None:
        self._ahead_ns += round(seconds * 1e9)


def drive_with(bench: Bench, left: float, right: float) -> None:
    bench.pilot.use(Policy(constant_model(left, right)))
    bench.run()


def test_idle_looks_but_does_not_drive(bench: Bench) -> None:
    bench.pilot.use(Policy(constant_model()))
    tick = bench.tick()
    assert bench.board.commands == []
    assert tick.observation is not None
    assert tick.action is None
    assert tick.state is State.IDLE


def test_running_turns_the_picture_into_a_motor_command(bench: Bench) -> None:
    drive_with(bench, 1.0, -0.5)
    tick = bench.tick()
    # 250 steps -> 255; 125 steps -> half of the way from the dead band (40) to 255.
    assert bench.board.commands[0].duties == Duties(1.0, -148 / 255)
    assert tick.duties == Duties(1.0, -148 / 255)
    assert tick.steps == Steps(250, -125)
    assert tick.state is State.RUNNING
    assert tick.delivery is not None
    stages = [
        tick.captured_ns,
        tick.started_ns,
        tick.observed_ns,
        tick.decided_ns,
        tick.delivery.written_ns,
        tick.delivery.acknowledged_ns,
    ]
    assert stages == sorted(stages)
    assert stages[0] > 0


def test_a_command_ends_soon_after_its_period(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    tick = bench.tick()
    held_ms = (bench.board.commands[0].deadline_ns - tick.started_ns) / 1e6
    assert held_ms == pytest.approx(500.0)


def test_a_command_is_guarded_by_the_cameras_freshness(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    bench.tick()
    assert bench.board.commands[0].guard()
    bench.camera.fresh = False
    assert not bench.board.commands[0].guard()


@pytest.mark.parametrize("where", ["camera", "motors", "model"])
def test_with_a_fault_nothing_is_driven_and_it_is_said_why(bench: Bench, where: str) -> None:
    fault = Fault("broken", "mend it")
    drive_with(bench, 1.0, 1.0)
    bench.tick()
    if where == "camera":
        bench.camera.fault = fault
    elif where == "motors":
        bench.board.fault = fault
    else:
        bench = Bench()
        bench.run()
    driven = len(bench.board.commands)
    tick = bench.tick()
    assert len(bench.board.commands) == driven
    assert bench.board.stops >= 1
    assert tick.state is State.FAULT
    assert tick.faults[0].kind == ("no-model" if where == "model" else "broken")


def test_without_a_picture_nothing_is_driven(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    bench.camera.has_picture = False  # just refused, and no fault yet
    tick = bench.tick()
    assert (tick.observation, tick.action) == (None, None)
    assert bench.board.asked == ["stop"]


@pytest.mark.parametrize("mode", Mode)
def test_nobody_is_missed_by_a_robot_that_does_not_drive_alone(bench: Bench, mode: Mode) -> None:
    bench.pilot.use(Policy(constant_model()))
    bench.link_fault = Fault("link-lost", "no workstation has been there")
    missed = [fault.kind for fault in bench.loop.faults(mode)]
    assert missed == (["link-lost"] if mode in (Mode.RUNNING, Mode.WAITING) else [])


@pytest.mark.parametrize("where", ["camera", "board"])
def test_a_gap_that_is_longer_than_forgiven_disarms(
    bench: Bench, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive_with(bench, 1.0, 1.0)
    clock = Clock(monkeypatch)
    bench.tick()
    part = bench.camera if where == "camera" else bench.board
    longest_s = Control().longest_hold_s
    assert longest_s == promised("gap-forgiven")
    for gap_s, state in ((longest_s - 0.1, State.RUNNING), (longest_s + 0.1, State.STOPPED)):
        part.fault = Fault("gone", "nobody knows where")
        assert bench.tick().state is State.FAULT
        for _ in range(10):
            clock.advance(gap_s / 10)
            bench.tick()
        part.fault = None
        driven = len(bench.board.commands)
        assert bench.tick().state is state
        assert len(bench.board.commands) == driven + (state is State.RUNNING)
    assert bench.helm.orders.stop.why == "nobody knows where"
    bench.run()
    assert bench.tick().state is State.RUNNING


def test_a_loop_that_stood_still_disarms(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    drive_with(bench, 1.0, 1.0)
    clock = Clock(monkeypatch)
    bench.tick()
    for paused_s, state in ((1.3, State.RUNNING), (1.5, State.STOPPED)):
        clock.advance(paused_s)
        assert bench.tick().state is state
    assert "stood still for 1." in bench.helm.orders.stop.why


@pytest.mark.parametrize("mode", [Mode.RUNNING, Mode.MANUAL, Mode.WAITING])
def test_a_board_that_was_reset_disarms(bench: Bench, mode: Mode) -> None:
    if mode is Mode.MANUAL:
        bench.hold(Duties(0.2, 0.2))
    else:
        if mode is Mode.RUNNING:
            bench.pilot.use(Policy(constant_model()))
        bench.helm.run(bench.stops, when_ready=mode is Mode.WAITING)
    bench.tick()
    assert bench.helm.orders.is_armed
    bench.board.resets += 1
    assert bench.tick().state is State.STOPPED
    assert bench.helm.orders.stop.why == "the board was reset"


def at_edge(floor: tuple[bool, bool]) -> Senses:
    return Senses(4.0, floor, at_edge=True, at_obstacle=False)


def test_an_edge_disarms_and_wants_a_floor_again(bench: Bench) -> None:
    drive_with(bench, 0.5, 0.5)
    assert bench.tick().state is State.RUNNING
    bench.board.edges, bench.board.senses = 1, at_edge((False, True))
    tick = bench.tick()
    assert (tick.state, tick.senses) == (State.STOPPED, bench.board.senses)
    assert bench.helm.orders.stop.why == "there was no floor in front of it"
    assert [fault.kind for fault in bench.loop.faults(Mode.RUNNING)] == ["edge"]
    assert bench.loop.faults(Mode.MANUAL) == (), "a hand may back off"
    bench.board.senses = at_edge((True, True))  # somebody has put it back
    assert bench.loop.faults(Mode.RUNNING) == ()
    bench.run()
    assert bench.tick().state is State.RUNNING


def test_an_edge_ends_a_hands_drive_once(bench: Bench) -> None:
    bench.hold(Duties(0.2, 0.2))
    assert bench.tick().state is State.MANUAL
    bench.board.edges, bench.board.senses = 1, at_edge((False, True))
    assert bench.tick().state is State.STOPPED
    bench.hold(Duties(-0.2, -0.2), press=Press(sender=7, number=2))
    for _ in range(3):
        assert bench.tick().state is State.MANUAL


def test_an_obstacle_holds_and_is_forgiven_when_it_goes_soon(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive_with(bench, 0.5, 0.5)
    clock = Clock(monkeypatch)
    bench.tick()
    near = Senses(0.1, (True, True), at_edge=False, at_obstacle=True)
    bench.board.senses = near
    for _ in range(3):
        clock.advance(0.4)
        tick = bench.tick()
        assert (tick.state, [fault.kind for fault in tick.faults]) == (State.FAULT, ["obstacle"])
        assert bench.board.asked[-1] == "stop"
    bench.board.senses = None
    clock.advance(0.4)
    assert bench.tick().state is State.RUNNING
    bench.board.senses = near
    for _ in range(7):
        clock.advance(0.4)
        bench.tick()
    assert bench.helm.orders.mode is Mode.STOPPED
    assert "10 cm ahead" in bench.helm.orders.stop.why


def test_a_robot_that_is_stuck_disarms_and_waits_for_a_word(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    drive_with(bench, 0.6, 0.6)
    clock = Clock(monkeypatch)
    for _ in range(2):
        for _ in range(8):
            assert bench.tick().state is State.RUNNING
            clock.advance(0.4)
        bench.tick()
        assert bench.board.asked[-1] == "stop"
        driven = len(bench.board.commands)
        for _ in range(10):
            clock.advance(0.4)
            tick = bench.tick()
            assert (tick.state, [fault.kind for fault in tick.faults]) == (State.STOPPED, ["stuck"])
        assert "the picture stands still" in bench.helm.orders.stop.why
        assert len(bench.board.commands) == driven
        assert bench.loop.faults(Mode.RUNNING) == (), "a `run` must be possible"
        bench.run()
    tick = bench.tick()
    assert (tick.state, tick.faults) == (State.RUNNING, ())


def test_a_hand_is_never_stuck(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock(monkeypatch)
    for _ in range(20):
        bench.hold(Duties(0.8, 0.8))
        assert bench.tick().state is State.MANUAL
        clock.advance(0.4)


def test_a_reset_of_a_board_that_stands_counts_for_nobody(bench: Bench) -> None:
    bench.board.resets += 1
    bench.tick()
    assert bench.stops == 1


def test_told_to_wait_it_begins_when_nothing_is_in_the_way(bench: Bench) -> None:
    bench.helm.run(bench.stops, when_ready=True)
    assert bench.tick().state is State.FAULT
    assert bench.board.commands == []
    bench.pilot.use(Policy(constant_model(0.5, 0.5)))
    bench.camera.fault = Fault("camera-starting", "no frame has come yet")
    assert bench.tick().state is State.FAULT
    bench.camera.fault = None
    assert bench.tick().state is State.RUNNING
    assert len(bench.board.commands) == 1


def test_waiting_is_not_a_gap_but_has_an_end(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.helm.run(bench.stops, when_ready=True)
    clock = Clock(monkeypatch)
    longest_s = Control().longest_wait_s
    assert longest_s == promised("longest-wait")
    for _ in range(3):
        bench.tick()
        clock.advance(longest_s / 3 - 0.1)
    bench.tick()
    assert bench.helm.orders.mode is Mode.WAITING
    clock.advance(0.5)
    bench.tick()
    assert bench.helm.orders.mode is Mode.STOPPED
    assert bench.helm.orders.stop.why.startswith("waited 30 s in vain: no model yet")
    bench.pilot.use(Policy(constant_model(0.5, 0.5)))
    bench.tick()
    assert bench.board.commands == []


def test_a_loop_that_stood_still_obeys_no_word_from_before(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.pilot.use(Policy(constant_model(0.5, 0.5)))
    bench.helm.run(bench.stops, when_ready=True)
    Clock(monkeypatch).advance(40)
    assert bench.tick().state is State.STOPPED
    assert bench.helm.orders.stop.why == "waited 40 s in vain: the loop stood still"


def test_a_word_is_over_when_nobody_is_there_any_more(bench: Bench) -> None:
    """So that nobody who comes later to have a look sets the robot in motion by it."""
    bench.pilot.use(Policy(constant_model(0.5, 0.5)))
    bench.camera.fault = Fault("camera-starting", "no frame has come yet")
    bench.helm.run(bench.stops, when_ready=True)
    bench.tick()
    bench.link_fault = Fault("link-lost", "no workstation has been there")
    assert bench.tick().state is State.STOPPED
    assert "no workstation has been there" in bench.helm.orders.stop.why
    bench.link_fault = bench.camera.fault = None
    bench.tick()
    assert bench.board.commands == []


def test_a_link_that_is_lost_while_driving_stops_the_robot(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    assert bench.tick().state is State.RUNNING
    bench.link_fault = Fault("link-lost", "no workstation has been there")
    driven = len(bench.board.commands)
    tick = bench.tick()
    assert (tick.state, [fault.kind for fault in tick.faults]) == (State.FAULT, ["link-lost"])
    assert (len(bench.board.commands), bench.board.asked[-1]) == (driven, "stop")
    bench.link_fault = None
    assert bench.tick().state is State.RUNNING


def test_driving_goes_on_by_itself_when_the_fault_is_gone(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    bench.camera.fault = Fault("camera-stalled", "no frame")
    bench.tick()
    bench.camera.fault = None
    assert bench.tick().state is State.RUNNING
    assert len(bench.board.commands) == 1


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_model_that_answers_nonsense_stops_and_is_given_up(bench: Bench, bad: float) -> None:
    drive_with(bench, bad, 0.0)
    for _ in range(3):
        tick = bench.tick()
        assert tick.state is State.FAULT
        assert tick.faults[-1].kind == "model-failed"
    assert bench.board.commands == []
    assert bench.tick().state is State.STOPPED
    assert "two finite numbers" in bench.helm.orders.stop.why
    bench.pilot.use(Policy(constant_model(0.5, 0.5)))
    assert bench.tick().state is State.STOPPED, "another model must not set it in motion"
    bench.run()
    assert bench.tick().state is State.RUNNING


class Hearing:
    """A trial that ends with 3 clean decisions, and what was said of it."""

    def __init__(self) -> None:
        self.verdicts: list[Verdict] = []
        self.trial = Trial("abc", 3, self.verdicts.append)

    @property
    def findings(self) -> list[Finding]:
        return [verdict.finding for verdict in self.verdicts]


@pytest.mark.parametrize("mode", [Mode.IDLE, Mode.RUNNING, Mode.STOPPED])
def test_a_model_on_trial_is_asked_even_while_the_robot_stands(bench: Bench, mode: Mode) -> None:
    hearing = Hearing()
    bench.pilot.use(Policy(constant_model(0.5, 0.5)), hearing.trial)
    if mode is Mode.RUNNING:
        bench.run()
    elif mode is Mode.STOPPED:
        bench.helm.stop()
    for _ in range(4):
        tick = bench.tick()
        assert (tick.action is not None) == (mode is Mode.RUNNING)
    assert hearing.findings == [Finding.PROVEN]
    assert bool(bench.board.commands) == (mode is Mode.RUNNING)


def test_a_model_that_fails_its_trial_is_given_up_before_it_drove(bench: Bench) -> None:
    hearing = Hearing()
    bench.pilot.use(Policy(constant_model(float("nan"), 0.0)), hearing.trial)
    for _ in range(5):
        bench.tick()
    assert hearing.findings == [Finding.BROKEN]
    assert "(nan, 0.0)" in hearing.verdicts[0].reason
    bench.run()
    assert bench.tick().faults[0].kind == "model-failed"
    assert bench.board.commands == []


def test_a_persons_hand_is_not_disturbed_by_a_trial(bench: Bench) -> None:
    hearing = Hearing()
    bench.pilot.use(Policy(constant_model(float("nan"), 0.0)), hearing.trial)
    bench.hold(Duties(0.2, 0.2))
    for _ in range(4):
        assert bench.tick().faults == ()
    assert hearing.findings == [Finding.SURVIVED]
    assert bench.board.stops == 0


def test_an_answer_that_came_too_late_proves_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    hearing = Hearing()
    policy = Policy(constant_model(0.5, 0.5))
    bench.pilot.use(policy, hearing.trial)
    answered = policy.decide(bench.camera.picture[:64, :64], policy.blank)
    began_ns = time.monotonic_ns()
    monkeypatch.setattr(policy, "decide", lambda *_: answered)
    ages = iter(range(1000))
    # Each look at the clock is half a second later than the last one.
    monkeypatch.setattr(time, "monotonic_ns", lambda: began_ns + next(ages) * 500_000_000)
    for _ in range(5):
        bench.loop.tick(began_ns)
    assert Finding.PROVEN not in hearing.findings


def test_a_new_model_takes_over_between_two_decisions(bench: Bench) -> None:
    drive_with(bench, 0.1, 0.1)
    before = bench.tick()
    bench.pilot.use(Policy(constant_model(0.2, 0.2)))
    after = bench.tick()
    assert (before.steps, after.steps) == (Steps(25, 25), Steps(50, 50))
    assert before.model_sha256 != after.model_sha256


def test_stop_during_inference_wins(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    drive_with(bench, 1.0, 1.0)
    bench.tick()
    policy = bench.pilot.policy
    assert policy is not None
    decide: Callable[[Picture, Memory], Answer] = policy.decide

    def decide_while_stopped(observation: Picture, memory: Memory) -> Answer:
        bench.helm.stop()
        return decide(observation, memory)

    monkeypatch.setattr(policy, "decide", decide_while_stopped)
    driven = len(bench.board.commands)
    tick = bench.tick()
    assert len(bench.board.commands) == driven
    assert tick.duties == STOP
    assert bench.camera.driving == [True, False]


def test_a_hand_needs_neither_camera_nor_model(bench: Bench) -> None:
    bench.camera.fault = Fault("camera-lost", "gone")
    bench.hold(Duties(0.2, 0.2))
    tick = bench.tick()
    assert tick.faults == ()
    assert bench.board.stops == 0
    assert tick.state is State.MANUAL


def test_the_camera_check_learns_whether_the_wheels_turn(bench: Bench) -> None:
    bench.tick()
    drive_with(bench, 0.5, 0.5)
    bench.tick()
    bench.pilot.use(Policy(constant_model(0.0, 0.0)))
    bench.tick()
    assert bench.camera.driving == [False, True, False]


def test_who_subscribes_hears_of_every_tick(bench: Bench) -> None:
    heard: list[Tick] = []
    bench.loop.subscribe(heard.append)
    ticks = [bench.tick() for _ in range(3)]
    assert heard == ticks
    assert [tick.sequence for tick in ticks] == [0, 1, 2]
    assert bench.loop.latest is ticks[-1]


class Beats(threading.Event):
    """What the loop waits for, in no time at all: the clock goes to the next beat, some times."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
        super().__init__()
        self.now_ns = 10**12
        self._left = number
        monkeypatch.setattr(time, "monotonic_ns", lambda: self.now_ns)

    def wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.now_ns += round(timeout * 1e9)
        self._left -= 1
        return self._left < 0


@pytest.mark.parametrize(("age_ms", "earlier_ms"), [(6, 0), (10, 4), (5, -1)])
def test_the_loop_beats_at_its_rate_and_goes_to_meet_the_frames(
    monkeypatch: pytest.MonkeyPatch, age_ms: int, earlier_ms: int
) -> None:
    beats = Beats(monkeypatch, 4)
    bench = Bench()
    heard: list[Tick] = []
    bench.loop.subscribe(heard.append)
    bench.camera.age_ns = age_ms * 1_000_000
    beats.now_ns = began_ns = beats.now_ns + 9 * 10**9  # the rest of the daemon took long to start
    bench.loop.run(beats)
    period_ns = (400 - earlier_ms) * 1_000_000
    assert [tick.due_ns for tick in heard] == [began_ns + n * period_ns for n in range(4)]
    assert heard[-1].missed_ticks == 0


def test_what_a_view_takes_is_worked_out_once(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes longer than all the rest of a decision."""
    made: list[tuple[int, float]] = []

    class Counted(Observer):
        def __init__(self, camera: CameraModel, view: FieldOfView) -> None:
            made.append((camera.width_px, view.horizontal_deg))
            super().__init__(camera, view)

    monkeypatch.setattr(control_loop, "Observer", Counted)
    wide = FULL_VIEW.horizontal_deg
    for _ in range(3):
        bench.tick()
    assert made == [(320, wide)]
    bench.camera.picture = np.full((480, 640, 3), 90, np.uint8)
    for _ in range(2):
        bench.tick()
    assert made[1:] == [(640, wide)]
    narrow = PolicyMetadata("narrow", FieldOfView(40.0, 40.0)).to_properties()
    bench.pilot.use(Policy(constant_model(metadata=narrow)))
    for _ in range(2):
        assert bench.tick().view == FieldOfView(40.0, 40.0)
    assert made[2:] == [(640, 40.0)]


def test_the_journal_says_once_what_the_robot_does_and_why_not(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "mbot_agent.control_loop")

    def said(act: Callable[[], Any] = lambda: None) -> list[str]:
        """In two beats after something."""
        caplog.clear()
        act()
        bench.tick()
        bench.tick()
        return [record.getMessage() for record in caplog.records if "loop" in record.name]

    def camera(fault: Fault | None) -> None:
        bench.camera.fault = fault

    mended = "; `workstation run` when that is mended"
    assert said() == []
    assert said(bench.run) == [
        "not driving: no model yet: `workstation push-model` sends one",
    ]
    assert said(lambda: bench.pilot.use(Policy(constant_model()))) == ["now running"]
    assert said(lambda: camera(Fault("a", "it is dark"))) == ["not driving: it is dark"]
    assert said(lambda: camera(Fault("b", "it is gone"))) == ["not driving: it is gone"]
    assert said(lambda: camera(None)) == ["now running"]
    assert said(bench.helm.stop) == ["now stopped"]  # the person knows why
    assert said(lambda: camera(Fault("a", "it is dark"))) == []  # it stands anyway
    camera(None)
    assert said(lambda: bench.hold(Duties(0.2, 0.2))) == ["now manual"]
    assert said(lambda: bench.helm.let_go(HAND)) == ["now stopped: let go"]
    assert said(bench.run) == ["now running"]
    why = "the board was reset"
    assert said(lambda: bench.helm.latch(why)) == [f"disarmed: {why}{mended}", "now stopped"]
    assert said(bench.run) == ["now running"]
    assert said(bench.helm.stop) == ["now stopped"]


def test_a_daemon_that_starts_with_a_fault_in_the_way_says_so_at_once(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    bench.run()
    bench.tick()
    assert [record.getMessage() for record in caplog.records] == [
        "not driving: no model yet: `workstation push-model` sends one"
    ]


@pytest.mark.parametrize("gap", ["held", "unacknowledged", "refused"])
def test_a_policy_goes_on_from_what_it_did_and_starts_over_behind_a_gap(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, gap: str
) -> None:
    bench.pilot.use(Policy(counting_model()))
    bench.run()

    def left() -> float:
        tick = bench.tick()
        return tick.action.left if tick.action is not None else -1.0

    assert [left() for _ in range(3)] == [0.0, 0.125, 0.25]
    with monkeypatch.context() as patch:
        if gap == "held":
            bench.camera.fault = Fault("camera-lost", "gone")
        elif gap == "unacknowledged":
            patch.setattr(bench.board, "delivery", lambda *_: None)
        else:
            patch.setattr(bench.helm, "steer_by_policy", lambda *_: None)
        bench.tick()
    bench.camera.fault = None
    assert [left() for _ in range(3)] == [0.0, 0.125, 0.25]
