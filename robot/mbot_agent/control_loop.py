"""The control loop: observe, decide, act, publish; 2.5 times a second, on one thread."""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from mbot_agent.arming import Hold, Mode, Orders, State
from mbot_agent.camera.stuck import StuckCheck
from mbot_agent.configuration import Configuration
from mbot_agent.faults import Fault, fault_ahead
from mbot_agent.hardware import Board, Camera, Frame
from mbot_agent.helm import Helm
from mbot_agent.metronome import Metronome, shift_towards_frames_ns
from mbot_agent.models.pilot import Pilot
from mbot_agent.tick import Tick
from mbot_protocol.drive.actions import to_steps
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.drive.wheel_command import WheelCommand
from mbot_protocol.policy.policy_contract import FieldOfView

log = logging.getLogger(__name__)

DEADLINE_SLACK_NS = 100_000_000
"""How far a command may outlive its decision period: room for a late tick, and with 2.5 Hz a stop
500 ms after a decision whose successor never comes (the bar is 600 ms)."""

STALLED_AFTER_NS = 1_000_000_000
"""A tick that begins so much later than a period after the last one: the wheels have stood since
the deadline, and what held the loop up may do so again. ArduPilot Rover, a faster loop, allows
0.2 s."""

ACKNOWLEDGE_WAIT_S = 0.1
"""The board replies in 2 to 3 ms; later, only this record goes without the time."""

Subscriber = Callable[[Tick], None]
"""Hears of every finished tick, on the loop's thread: it must return at once."""


class ControlLoop:
    """Decides at every beat; `run` is the thread.

    Attributes:
        latest: the last finished tick; None before the first. Any thread may look.

    """

    def __init__(
        self,
        configuration: Configuration,
        camera: Camera,
        board: Board,
        helm: Helm,
        pilot: Pilot,
        link_fault: Callable[[], Fault | None] = lambda: None,
    ) -> None:
        self._camera_settings = configuration.camera
        self._wheels = configuration.motors
        self._rate_hz = configuration.control.decision_rate_hz
        self._camera = camera
        self._board = board
        self._helm = helm
        self._pilot = pilot
        self._link_fault = link_fault
        self._metronome = Metronome(self._rate_hz)
        self._subscribers: list[Subscriber] = []
        self._observer: Observer | None = None
        self._observer_for: tuple[tuple[int, ...], FieldOfView] | None = None
        self._hold = Hold(configuration.control.longest_hold_s)
        self._longest_wait_s = configuration.control.longest_wait_s
        self._stuck = StuckCheck()
        self._resets, self._edges = board.resets, board.edges
        self._ticks = 0
        self.latest: Tick | None = None

    def subscribe(self, subscriber: Subscriber) -> None:
        """Have it hear of every tick from now on; before `run` begins."""
        self._subscribers.append(subscriber)

    def run(self, closing: threading.Event) -> None:
        """Tick until `closing` is set."""
        self._metronome = Metronome(self._rate_hz)
        while (due_ns := self._metronome.wait(closing)) is not None:
            self.tick(due_ns)

    def tick(self, due_ns: int) -> Tick:
        """One beat."""
        tick = self._observe(due_ns)
        tick = self._decide(tick)
        tick = self._act(tick)
        self._reflect(tick)
        self._publish(tick)
        return tick

    def forgive(self) -> None:
        """A person wants to drive: what was held against the camera is forgotten; any thread."""
        self._camera.forgive()

    @property
    def light(self) -> str:
        """What the camera's automatics do."""
        return self._camera.light

    def faults(self, mode: Mode) -> tuple[Fault, ...]:
        """What is in the way of a mode now; any thread may ask. A person's hand needs neither
        eyes nor model, and may back off from an edge.
        """
        found = [self._board.fault]
        if mode is not Mode.MANUAL:
            found += [fault_ahead(self._board.senses), self._camera.fault, self._pilot.fault]
        if mode in (Mode.RUNNING, Mode.WAITING):
            found.append(self._link_fault())
        if mode is Mode.STOPPED:  # why it stands; a `run` says that this is mended
            found.append(self._stuck.fault)
        return tuple(fault for fault in found if fault is not None)

    def _observe(self, due_ns: int) -> Tick:
        """What is wanted, what is wrong, and the policy's picture of the newest frame."""
        started_ns = time.monotonic_ns()
        self._pilot.change_over()
        self._helm.end_manual_if_due()
        orders = self._arm_or_latch(started_ns)
        before = self.latest
        if before is not None and (self._metronome.missed, orders.epoch) != (
            before.missed_ticks,
            before.orders.epoch,
        ):  # also a stop and a `run` between two beats
            self._pilot.forget()
        frame = self._camera.latest()
        tick = Tick(
            sequence=self._ticks,
            due_ns=due_ns,
            started_ns=started_ns,
            missed_ticks=self._metronome.missed,
            orders=orders,
            faults=self.faults(orders.mode),
            model_sha256=self._pilot.sha256,
            senses=self._board.senses,
            mark=self._helm.take_mark(),
        )
        if frame is None:
            return tick
        self._follow_the_camera(started_ns - frame.captured_ns)
        observation = self._see(frame)
        return replace(
            tick,
            captured_ns=frame.captured_ns,
            observation=observation,
            view=self._pilot.view,
            observed_ns=time.monotonic_ns(),
        )

    def _arm_or_latch(self, now_ns: int) -> Orders:
        """The orders for this tick. A robot that waits begins when nothing is in the way any more;
        one that drives is disarmed by what it must not forgive by itself.
        """
        orders = self._helm.orders
        faults = self.faults(orders.mode)
        if orders.mode is Mode.WAITING:
            self._begin_or_give_up(orders, faults, now_ns)
        reset, self._resets = self._board.resets != self._resets, self._board.resets
        edge, self._edges = self._board.edges != self._edges, self._board.edges
        driving = orders.mode is Mode.RUNNING
        paused_ns = now_ns - self.latest.started_ns if self.latest is not None else 0
        overdue = self._hold.too_long(faults if driving else (), now_ns)
        if reset:
            self._helm.latch("the board was reset")
        elif edge:
            self._helm.latch("there was no floor in front of it")
        elif driving and paused_ns > self._metronome.period_ns + STALLED_AFTER_NS:
            self._helm.latch(f"the loop stood still for {paused_ns / 1e9:.1f} s")
        elif overdue is not None:
            self._helm.latch(overdue.detail)
        return self._helm.orders

    def _begin_or_give_up(self, orders: Orders, faults: tuple[Fault, ...], now_ns: int) -> None:
        """A word counts for a while, and only while somebody is there, where that is wanted: nobody
        who comes later to have a look sets the robot in motion by it.
        """
        waited_s = (now_ns - orders.given_ns) / 1e9
        if (lost := self._link_fault()) is not None:
            self._helm.latch(f"nobody was there any more to wait for: {lost.detail}")
        elif waited_s > self._longest_wait_s:
            why = faults[0].detail if faults else "the loop stood still"
            self._helm.latch(f"waited {waited_s:.0f} s in vain: {why}")
        elif not faults:
            self._helm.begin(orders)

    def _decide(self, tick: Tick) -> Tick:
        """The policy's action, if it is to drive; or the fault that it has met."""
        due_ns = tick.started_ns + self._metronome.period_ns
        if tick.state is not State.RUNNING or tick.observation is None:
            by_hand = tick.state is State.MANUAL
            self._pilot.rehearse(None if by_hand else tick.observation, due_ns)
            return self._beside_the_hand(tick, due_ns) if by_hand else tick
        memory = self._pilot.memory
        answer = self._pilot.decide(tick.observation, due_ns)
        tick = replace(tick, memory=memory)
        if isinstance(answer, Fault):
            if self._pilot.has_given_up:
                self._helm.latch(answer.detail)
            return replace(tick, faults=(answer,))
        return replace(tick, action=answer, decided_ns=time.monotonic_ns())

    def _beside_the_hand(self, tick: Tick, due_ns: int) -> Tick:
        """What the policy would have done, for the recording: the hand has driven already."""
        if tick.observation is None or not self._camera.is_fresh():
            return tick
        memory = self._pilot.memory
        answer = self._pilot.would_do(tick.observation, due_ns)
        return replace(tick, memory=memory, would_have_done=answer) if answer else tick

    def _act(self, tick: Tick) -> Tick:
        """Hand the action to the board; without one, the wheels stand unless a person drives."""
        if tick.action is None:
            self._camera.drives(False)
            if tick.state is State.MANUAL:
                return replace(tick, by_hand=self._helm.by_hand, driver=self._helm.driver)
            self._helm.rest(tick.orders)
            return tick
        steps = to_steps(tick.action.left, tick.action.right)
        duties = self._wheels.duties(steps)
        deadline_ns = tick.started_ns + self._metronome.period_ns + DEADLINE_SLACK_NS
        ticket = self._helm.steer_by_policy(
            tick.orders, WheelCommand(duties, deadline_ns, guard=self._camera.is_fresh)
        )
        if ticket is None:  # somebody changed the orders meanwhile
            self._camera.drives(False)
            return replace(tick, steps=steps)
        delivery = self._board.delivery(ticket, ACKNOWLEDGE_WAIT_S)
        self._camera.drives(not duties.is_stop)
        return replace(tick, steps=steps, duties=duties, delivery=delivery)

    def _reflect(self, tick: Tick) -> None:
        """What follows for the next beat.

        A policy with memory goes on from what its action did, and only without a break: in a
        decision that was held, refused or missed the robot did something else. A robot that is
        stuck is disarmed.
        """
        if tick.steps is not None and tick.delivery is not None:
            self._pilot.drove(*tick.steps.action)
        elif tick.would_have_done is not None:  # and the hand did this
            self._pilot.drove(*self._wheels.steps(tick.by_hand).action)
        else:
            self._pilot.forget()
        if (fault := self._stuck.judge(tick)) is not None:
            self._helm.latch(fault.detail)

    def _publish(self, tick: Tick) -> None:
        """Tell the journal what has changed, and everybody who listens."""
        self._ticks += 1
        previous, self.latest = self.latest, tick
        stop = tick.orders.stop
        if previous is not None and stop != previous.orders.stop and stop.why:
            log.warning("disarmed: %s; `workstation run` when that is mended", stop.why)
        before = (previous.state, previous.faults) if previous is not None else (State.IDLE, ())
        if before != (tick.state, tick.faults) and tick.state is State.FAULT:
            log.warning("not driving: %s", "; ".join(fault.detail for fault in tick.faults))
        elif before[0] is not tick.state:
            log.info("now %s%s", tick.state.value, ": let go" if tick.hand_let_go else "")
        for subscriber in self._subscribers:
            subscriber(tick)

    def _see(self, frame: Frame) -> Picture:
        """The frame as the policy sees it: shape (64, 64, 3), uint8, RGB."""
        view = self._pilot.view
        if self._observer is None or self._observer_for != (frame.picture.shape, view):
            height_px, width_px, _ = frame.picture.shape
            self._observer = Observer(self._camera_settings.model_at(width_px, height_px), view)
            self._observer_for = (frame.picture.shape, view)
        return self._observer.observe(frame.picture)

    def _follow_the_camera(self, age_ns: int) -> None:
        """Shift the next beats so that each finds a frame just arrived."""
        self._metronome.shift(
            shift_towards_frames_ns(age_ns, self._camera.interval_ns, self._metronome.period_ns)
        )
