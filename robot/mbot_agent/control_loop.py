"""The control loop: look, decide, act, tell; 2.5 times a second, on one thread."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from mbot_agent.camera import CaptureThread, Frame
from mbot_agent.configuration import Configuration
from mbot_agent.faults import Fault, Notice
from mbot_agent.helm import Helm, Mode, Orders, State, state_of
from mbot_agent.metronome import Metronome, shift_towards_frames_ns
from mbot_agent.motors import DriveCommand, Motors
from mbot_agent.policy import Policy, PolicyError
from mbot_agent.telemetry import Record, Telemetry
from mbot_agent.trial import Trial
from mbot_protocol.actions import to_steps
from mbot_protocol.picture import Observer, Picture
from mbot_protocol.policy_contract import FULL_VIEW, FieldOfView
from mbot_protocol.schema import SCHEMA_VERSION
from mbot_protocol.v1 import messages_pb2 as messages

log = logging.getLogger(__name__)

DEADLINE_SLACK_NS = 100_000_000
"""How far a command may outlive its decision period: room for a late tick, and with 2.5 Hz a stop
500 ms after a decision whose successor never comes (the bar is 600 ms)."""

ACKNOWLEDGE_WAIT_S = 0.1
"""The board replies in 2 to 3 ms; later, only this record goes without the time."""

WIRE_STATES = {
    State.IDLE: messages.STATE_IDLE,
    State.RUNNING: messages.STATE_RUNNING,
    State.STOPPED: messages.STATE_STOPPED,
    State.MANUAL: messages.STATE_MANUAL,
    State.FAULT: messages.STATE_FAULT,
}


@dataclass(frozen=True, slots=True)
class Situation:
    """What the last tick found; the status service reads it."""

    state: State
    faults: tuple[Fault, ...]
    missed_ticks: int
    ticks: int


class ControlLoop:
    """Decides at every beat. `run` is the thread; `use` may be called from another."""

    def __init__(
        self,
        configuration: Configuration,
        session_id: int,
        camera: CaptureThread,
        motors: Motors,
        helm: Helm,
        telemetry: Telemetry,
        link_fault: Callable[[], Fault | None] = lambda: None,
    ) -> None:
        self._robot_id = configuration.robot_id
        self._session_id = session_id
        self._camera_settings = configuration.camera
        self._wheels = configuration.motors.to_maps()
        self._rate_hz = configuration.control.decision_rate_hz
        self._camera = camera
        self._motors = motors
        self._helm = helm
        self._telemetry = telemetry
        self._link_fault = link_fault
        self._metronome = Metronome(self._rate_hz)
        self._policy: Policy | None = None
        self._trial = Trial("", 0, lambda _: None)
        self._incoming: deque[tuple[Policy, Trial]] = deque()
        self.notices: tuple[Notice, ...] = ()
        self._policy_fault: Fault | None = None
        self._ticks = 0
        self._observer: Observer | None = None
        self._observer_for: tuple[tuple[int, ...], FieldOfView] | None = None
        self.situation = Situation(State.IDLE, (), 0, 0)  # until the first tick has looked

    @property
    def policy(self) -> Policy | None:
        """The model in use."""
        return self._policy

    def use(self, policy: Policy, trial: Trial | None = None) -> None:
        """Switch to this model before the next decision; the trial counts how it does.

        A model on trial is asked even while the robot stands, and its answer goes nowhere: so it
        proves itself, or crashes the daemon, before anything moves by it.
        """
        self._incoming.append((policy, trial or Trial(policy.sha256, 0, lambda _: None)))

    def tell(self, notices: tuple[Notice, ...]) -> None:
        """What telemetry and status shall show beside the faults, from now on; any thread."""
        self.notices = notices

    def run(self, closing: threading.Event, on_tick: Callable[[Situation], None]) -> None:
        """Tick until `closing` is set; `on_tick` hears of every finished tick."""
        self._metronome = Metronome(self._rate_hz)
        while (due_ns := self._metronome.wait(closing)) is not None:
            self.tick(due_ns)
            on_tick(self.situation)

    def tick(self, due_ns: int) -> None:
        """One beat: look, decide, act, tell."""
        started_ns = time.monotonic_ns()
        self._take_next_policy()
        self._helm.end_manual_if_due()
        orders = self._helm.orders
        frame = self._camera.latest()
        faults = self.faults(orders.mode)
        state = state_of(orders.mode, faults)
        record = messages.Decision(
            schema_version=SCHEMA_VERSION,
            robot_id=self._robot_id,
            session_id=self._session_id,
            sequence=self._ticks,
            due_monotonic_ns=due_ns,
            started_monotonic_ns=started_ns,
        )
        observation = self._observe(frame, record)
        if state is State.RUNNING and frame is not None and observation is not None:
            faults = self._drive(orders, frame, observation, record)
            state = state_of(orders.mode, faults)
        else:
            if state is not State.MANUAL:
                self._helm.rest(orders)
            self._try(state, observation, started_ns)
        if frame is not None:
            age_ns = started_ns - frame.captured_ns
            self._metronome.shift(
                shift_towards_frames_ns(age_ns, self._camera.interval_ns, self._metronome.period_ns)
            )
        self._camera.check.drives(record.board_m1 != 0 or record.board_m2 != 0)
        self._finish(record, observation, state, faults)

    def _take_next_policy(self) -> None:
        while self._incoming:
            self._policy, self._trial = self._incoming[0]
            self._policy_fault = None
            self._incoming.popleft()

    def faults(self, mode: Mode) -> tuple[Fault, ...]:
        """What is in the way of a mode now; any thread may ask. A person's hand needs neither
        eyes nor model.
        """
        found = [self._motors.fault]
        if mode is not Mode.MANUAL:
            found += [self._camera.fault, self._model_fault()]
        if mode is Mode.RUNNING:
            found.append(self._link_fault())
        return tuple(fault for fault in found if fault is not None)

    def _model_fault(self) -> Fault | None:
        if self._incoming:
            return None
        if self._policy is None:
            return Fault("no-model", "no model yet: `workstation push-model` sends one")
        return self._policy_fault

    def _observe(self, frame: Frame | None, record: messages.Decision) -> Picture | None:
        if frame is None:
            return None
        view = self._policy.metadata.view if self._policy is not None else FULL_VIEW
        if self._observer is None or self._observer_for != (frame.picture.shape, view):
            height_px, width_px, _ = frame.picture.shape
            self._observer = Observer(self._camera_settings.model_at(width_px, height_px), view)
            self._observer_for = (frame.picture.shape, view)
        observation = self._observer.observe(frame.picture)
        record.captured_monotonic_ns = frame.captured_ns
        record.observed_monotonic_ns = time.monotonic_ns()
        return observation

    def _drive(
        self, orders: Orders, frame: Frame, observation: Picture, record: messages.Decision
    ) -> tuple[Fault, ...]:
        """Ask the policy and hand its answer to the motors. Returns the faults met on the way."""
        assert self._policy is not None  # no-model is a fault, and with a fault nothing runs
        try:
            left, right = self._policy.act(observation)
        except PolicyError as error:
            self._helm.rest(orders)
            return (self._policy_failed(error),)
        self._policy_answered(record.started_monotonic_ns)
        steps = to_steps(left, right)
        joystick = self._wheels.to_board(steps)
        record.decided_monotonic_ns = time.monotonic_ns()
        record.action.left, record.action.right = left, right
        record.steps.left, record.steps.right = steps.left, steps.right
        deadline_ns = record.started_monotonic_ns + self._metronome.period_ns + DEADLINE_SLACK_NS
        ticket = self._helm.steer_by_policy(
            orders, DriveCommand(joystick, deadline_ns, guard=self._camera.is_fresh)
        )
        if ticket is None:
            return ()  # somebody changed the orders meanwhile
        record.board_m1, record.board_m2 = joystick.m1, joystick.m2
        delivery = self._motors.delivery(ticket, ACKNOWLEDGE_WAIT_S)
        if delivery is not None:
            record.written_monotonic_ns = delivery.written_ns
            record.acknowledged_monotonic_ns = delivery.acknowledged_ns
        return ()

    def _try(self, state: State, observation: Picture | None, started_ns: int) -> None:
        """Ask a model on trial though nobody needs its answer; not while a person drives."""
        if self._policy is None or not self._trial.is_open:
            return
        if observation is None or state is State.MANUAL or self._policy_fault is not None:
            self._trial.idle()
            return
        try:
            self._policy.act(observation)
        except PolicyError as error:
            self._policy_failed(error)
        else:
            self._policy_answered(started_ns)

    def _policy_answered(self, started_ns: int) -> None:
        if time.monotonic_ns() - started_ns <= self._metronome.period_ns:
            self._trial.clean()
        else:
            self._trial.idle()

    def _policy_failed(self, error: PolicyError) -> Fault:
        fault = Fault("model-failed", f"{error}; push another one or `workstation rollback`")
        self._trial.failed(str(error))
        if self._trial.is_broken:
            log.error("%s", fault.detail)
            self._policy_fault = fault
        return fault

    def _finish(
        self,
        record: messages.Decision,
        observation: Picture | None,
        state: State,
        faults: tuple[Fault, ...],
    ) -> None:
        self._ticks += 1
        previous = self.situation
        self.situation = Situation(state, faults, self._metronome.missed, self._ticks)
        if (previous.state, previous.faults) != (state, faults) and state is State.FAULT:
            log.warning("not driving: %s", "; ".join(fault.detail for fault in faults))
        elif previous.state is not state:
            log.info("now %s", state.value)
        record.state = WIRE_STATES[state]
        record.faults.extend(messages.Fault(kind=f.kind, detail=f.detail) for f in faults)
        record.notices.extend(messages.Notice(kind=n.kind, detail=n.detail) for n in self.notices)
        record.missed_ticks = self._metronome.missed
        if self._policy is not None:
            record.model_sha256 = self._policy.sha256
        self._telemetry.offer(Record(record, observation))
