import time
from collections.abc import Callable

import numpy as np
import pytest

from mbot_agent.camera import Frame
from mbot_agent.configuration import Configuration
from mbot_agent.control_loop import ControlLoop
from mbot_agent.faults import Fault, Notice
from mbot_agent.helm import Helm, Mode, State
from mbot_agent.motors import Delivery, DriveCommand
from mbot_agent.policy import Policy
from mbot_agent.telemetry import Record
from mbot_agent.trial import Finding, Trial, Verdict
from mbot_protocol.mcore import Joystick
from mbot_protocol.picture import Picture
from mbot_protocol.v1.messages_pb2 import STATE_FAULT, STATE_RUNNING

from .tiny_models import constant_model


class FakeMotors:
    """Obeys at once and remembers."""

    def __init__(self) -> None:
        self.fault: Fault | None = None
        self.commands: list[DriveCommand] = []
        self.stops = 0

    def drive(self, command: DriveCommand) -> int:
        self.commands.append(command)
        return len(self.commands)

    def delivery(self, ticket: int, timeout_s: float) -> Delivery | None:
        assert ticket == len(self.commands)
        assert timeout_s > 0
        return Delivery(time.monotonic_ns(), time.monotonic_ns())

    def stop(self) -> None:
        self.stops += 1


class FakeCheck:
    def __init__(self) -> None:
        self.driving: list[bool] = []

    def drives(self, driving: bool) -> None:
        self.driving.append(driving)


class FakeCamera:
    """One picture, as fresh as the test says."""

    def __init__(self) -> None:
        self.fault: Fault | None = None
        self.check = FakeCheck()
        self.fresh = True
        self.interval_ns = 33_333_333
        self.picture: Picture = np.full((240, 320, 3), 90, np.uint8)

    def latest(self) -> Frame:
        return Frame(self.picture, time.monotonic_ns() - 10_000_000)

    def is_fresh(self) -> bool:
        return self.fresh


class Bench:
    """A control loop among fakes; `tick` is one beat."""

    def __init__(self) -> None:
        self.motors = FakeMotors()
        self.camera = FakeCamera()
        self.records: list[Record] = []
        self.helm = Helm(self.motors, Mode.IDLE)  # pyright: ignore[reportArgumentType]
        self.loop = ControlLoop(
            Configuration(robot_id="mbot-1"),
            42,
            self.camera,  # pyright: ignore[reportArgumentType]
            self.motors,  # pyright: ignore[reportArgumentType]
            self.helm,
            self,  # pyright: ignore[reportArgumentType]
        )

    def offer(self, record: Record) -> None:
        self.records.append(record)

    def tick(self) -> Record:
        self.loop.tick(time.monotonic_ns())
        return self.records[-1]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def drive_with(bench: Bench, left: float, right: float) -> None:
    bench.loop.use(Policy(constant_model(left, right)))
    bench.helm.run()


def test_idle_looks_but_does_not_drive(bench: Bench) -> None:
    bench.loop.use(Policy(constant_model()))
    record = bench.tick()
    assert bench.motors.commands == []
    assert record.observation is not None
    assert not record.decision.HasField("action")
    assert bench.loop.situation.state is State.IDLE


def test_running_turns_the_picture_into_a_motor_command(bench: Bench) -> None:
    drive_with(bench, 1.0, -0.5)
    decision = bench.tick().decision
    # 250 steps -> 255; 125 steps -> half of the way from the dead band (40) to 255.
    assert bench.motors.commands[0].joystick == Joystick(-255, -148)
    assert (decision.board_m1, decision.board_m2) == (-255, -148)
    assert (decision.steps.left, decision.steps.right) == (250, -125)
    assert decision.state == STATE_RUNNING
    stages = [
        decision.captured_monotonic_ns,
        decision.started_monotonic_ns,
        decision.observed_monotonic_ns,
        decision.decided_monotonic_ns,
        decision.written_monotonic_ns,
        decision.acknowledged_monotonic_ns,
    ]
    assert stages == sorted(stages)
    assert stages[0] > 0


def test_a_command_ends_soon_after_its_period(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    decision = bench.tick().decision
    held_ms = (bench.motors.commands[0].deadline_ns - decision.started_monotonic_ns) / 1e6
    assert held_ms == pytest.approx(500.0)


def test_a_command_is_guarded_by_the_cameras_freshness(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    bench.tick()
    assert bench.motors.commands[0].guard()
    bench.camera.fresh = False
    assert not bench.motors.commands[0].guard()


@pytest.mark.parametrize("where", ["camera", "motors", "model"])
def test_with_a_fault_nothing_is_driven_and_it_is_said_why(bench: Bench, where: str) -> None:
    fault = Fault("broken", "mend it")
    drive_with(bench, 1.0, 1.0)
    bench.tick()
    if where == "camera":
        bench.camera.fault = fault
    elif where == "motors":
        bench.motors.fault = fault
    else:
        bench = Bench()
        bench.helm.run()
    driven = len(bench.motors.commands)
    decision = bench.tick().decision
    assert len(bench.motors.commands) == driven
    assert bench.motors.stops >= 1
    assert decision.state == STATE_FAULT
    assert decision.faults[0].kind == ("no-model" if where == "model" else "broken")


def test_driving_goes_on_by_itself_when_the_fault_is_gone(bench: Bench) -> None:
    drive_with(bench, 1.0, 1.0)
    bench.camera.fault = Fault("camera-stalled", "no frame")
    bench.tick()
    bench.camera.fault = None
    assert bench.tick().decision.state == STATE_RUNNING
    assert len(bench.motors.commands) == 1


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_model_that_answers_nonsense_stops_and_is_given_up(bench: Bench, bad: float) -> None:
    drive_with(bench, bad, 0.0)
    for _ in range(4):
        decision = bench.tick().decision
        assert decision.state == STATE_FAULT
        assert decision.faults[-1].kind == "model-failed"
    assert bench.motors.commands == []
    assert bench.motors.stops == 4
    bench.loop.use(Policy(constant_model(0.5, 0.5)))
    assert bench.tick().decision.state == STATE_RUNNING


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
    bench.loop.use(Policy(constant_model(0.5, 0.5)), hearing.trial)
    if mode is Mode.RUNNING:
        bench.helm.run()
    elif mode is Mode.STOPPED:
        bench.helm.stop()
    for _ in range(4):
        decision = bench.tick().decision
        assert decision.HasField("action") == (mode is Mode.RUNNING)
    assert hearing.findings == [Finding.PROVEN]
    assert bool(bench.motors.commands) == (mode is Mode.RUNNING)


def test_a_model_that_fails_its_trial_is_given_up_before_it_drove(bench: Bench) -> None:
    hearing = Hearing()
    bench.loop.use(Policy(constant_model(float("nan"), 0.0)), hearing.trial)
    for _ in range(5):
        bench.tick()
    assert hearing.findings == [Finding.BROKEN]
    assert "(nan, 0.0)" in hearing.verdicts[0].reason
    bench.helm.run()
    assert bench.tick().decision.faults[0].kind == "model-failed"
    assert bench.motors.commands == []


def test_a_persons_hand_is_not_disturbed_by_a_trial(bench: Bench) -> None:
    hearing = Hearing()
    bench.loop.use(Policy(constant_model(float("nan"), 0.0)), hearing.trial)
    bench.helm.steer_by_hand(Joystick(-50, 50), 10**9)
    for _ in range(4):
        assert bench.tick().decision.faults == []
    assert hearing.findings == [Finding.SURVIVED]
    assert bench.motors.stops == 0


def test_an_answer_that_came_too_late_proves_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    hearing = Hearing()
    policy = Policy(constant_model(0.5, 0.5))
    bench.loop.use(policy, hearing.trial)
    answered = policy.act(bench.camera.picture[:64, :64])
    began_ns = time.monotonic_ns()
    monkeypatch.setattr(policy, "act", lambda _: answered)
    ages = iter(range(1000))
    # Each look at the clock is half a second later than the last one.
    monkeypatch.setattr(time, "monotonic_ns", lambda: began_ns + next(ages) * 500_000_000)
    for _ in range(5):
        bench.loop.tick(began_ns)
    assert Finding.PROVEN not in hearing.findings


def test_notices_go_out_with_every_record(bench: Bench) -> None:
    assert bench.tick().decision.notices == []
    bench.loop.tell((Notice("model-rolled-back", "new was rolled back to old: nonsense"),))
    (notice,) = bench.tick().decision.notices
    assert (notice.kind, notice.detail) == (
        "model-rolled-back",
        "new was rolled back to old: nonsense",
    )


def test_a_new_model_takes_over_between_two_decisions(bench: Bench) -> None:
    drive_with(bench, 0.1, 0.1)
    before = bench.tick().decision
    bench.loop.use(Policy(constant_model(0.2, 0.2)))
    after = bench.tick().decision
    assert (before.steps.left, after.steps.left) == (25, 50)
    assert before.model_sha256 != after.model_sha256


def test_stop_during_inference_wins(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    drive_with(bench, 1.0, 1.0)
    bench.tick()
    policy = bench.loop.policy
    assert policy is not None
    act: Callable[[Picture], tuple[float, float]] = policy.act

    def act_while_stopped(observation: Picture) -> tuple[float, float]:
        bench.helm.stop()
        return act(observation)

    monkeypatch.setattr(policy, "act", act_while_stopped)
    driven = len(bench.motors.commands)
    decision = bench.tick().decision
    assert len(bench.motors.commands) == driven
    assert (decision.board_m1, decision.board_m2) == (0, 0)


def test_a_hand_needs_neither_camera_nor_model(bench: Bench) -> None:
    bench.camera.fault = Fault("camera-lost", "gone")
    bench.helm.steer_by_hand(Joystick(-50, 50), 10**9)
    assert bench.tick().decision.faults == []
    assert bench.motors.stops == 0
    assert bench.loop.situation.state is State.MANUAL


def test_the_camera_check_learns_whether_the_wheels_turn(bench: Bench) -> None:
    bench.tick()
    drive_with(bench, 0.5, 0.5)
    bench.tick()
    bench.loop.use(Policy(constant_model(0.0, 0.0)))
    bench.tick()
    assert bench.camera.check.driving == [False, True, False]
