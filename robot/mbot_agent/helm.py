"""The helm: who drives, and the lock that makes a change of mind final.

The control loop and the command service both move the wheels, but only through here: once
`stop` has returned, no decision begun before it can reach a motor, and no `run` or `drive` that
does not know of it is obeyed.
"""

import threading
import time
from dataclasses import dataclass, field

from mbot_agent.arming import Driver, Mark, Mode, Orders
from mbot_agent.hardware import Board
from mbot_protocol.drive.wheel_command import STOP, Duties, WheelCommand
from mbot_protocol.errors import RefusedError

MARKED_WITHIN_NS = 2_500_000_000
"""A drive is recorded for 3 s after its end; the mark comes with the next beat, 0.4 s later."""

MOST_SENDERS = 64
"""Whose last press is remembered. The one that is forgotten had its last command long ago: none is
good for more than a second."""


@dataclass(frozen=True, slots=True)
class Press:
    """One of the times that a hand has taken hold.

    Attributes:
        sender: whose hand.
        number: which time; grows.
        name: whose, for people to read; not what tells two presses apart.

    """

    sender: int
    number: int
    name: str = field(default="", compare=False)


class Helm:
    """Keeps the orders and hands commands to the board under one lock."""

    def __init__(self, board: Board, orders: Orders) -> None:
        self._board = board
        self._lock = threading.Lock()
        self._orders = orders
        self._manual_until_ns = 0
        self._by_hand = STOP
        self._press: Press | None = None
        self._driver: Driver | None = None
        self._mark: Mark | None = None
        self._over: dict[int, int] = {}

    @property
    def by_hand(self) -> Duties:
        """What a person's hand last told the wheels; means nothing unless the mode is manual."""
        return self._by_hand

    @property
    def driver(self) -> Driver | None:
        """Whose hand that is, likewise."""
        return self._driver

    def mark(self, mark: Mark) -> None:
        """Note for the recording that what has just been was wrong; moves and stops nothing.

        Raises:
            RefusedError: nothing is recorded any more that it could be said of.

        """
        orders = self._orders
        stood_ns = time.monotonic_ns() - max(orders.stop.at_ns, orders.let_go_ns)
        if not orders.is_armed and (orders.mode is Mode.IDLE or stood_ns > MARKED_WITHIN_NS):
            raise RefusedError(
                f"the robot has stood for more than {MARKED_WITHIN_NS / 1e9:.0f} s: the recording "
                "has ended; `workstation drives` judges what is fetched"
            )
        self._mark = mark

    def take_mark(self) -> Mark | None:
        """What was noted since the last time; for the loop's thread."""
        mark, self._mark = self._mark, None
        return mark

    @property
    def orders(self) -> Orders:
        """What is wanted now."""
        return self._orders

    def run(self, seen_stops: int, *, when_ready: bool = False) -> None:
        """Let the policy drive, or wait until it can.

        Raises:
            RefusedError: there has been a stop that the sender does not know of.

        """
        with self._lock:
            mode = Mode.WAITING if when_ready else Mode.RUNNING
            orders = self._orders.armed(mode, seen_stops, time.monotonic_ns())
            if self._orders.mode is Mode.MANUAL:
                self._board.stop()
            self._end_press()
            self._orders = orders
            self._board.arm()

    def stop(self, by: str = "") -> None:
        """Stop, and stay so until somebody who knows of this stop says otherwise."""
        with self._lock:
            self._end_press()
            self._orders = self._orders.stopped(time.monotonic_ns(), by=by)
            self._board.disarm()
            self._board.stop()

    def latch(self, why: str) -> None:
        """Disarm a robot that is armed, for a reason that it must not forgive by itself.

        The loop's next beat writes it into the log: who calls may hold a lock.
        """
        with self._lock:
            if not self._orders.is_armed:
                return
            self._end_press()
            self._orders = self._orders.stopped(time.monotonic_ns(), why=why)
            self._board.disarm()
            self._board.stop()

    def begin(self, orders: Orders) -> None:
        """What these orders were waiting for has come."""
        with self._lock:
            if self._orders == orders and orders.mode is Mode.WAITING:
                self._orders = orders.ready()
                self._board.arm()

    def steer_by_hand(self, duties: Duties, until_ns: int, seen_stops: int, press: Press) -> None:
        """Drive as a person says, until then at most (monotonic).

        Raises:
            RefusedError: there has been a stop that the sender does not know of, or this press is
                over: the hand has let go, or something has ended it.

        """
        with self._lock:
            self._release_if_due(time.monotonic_ns())
            orders = self._orders.armed(Mode.MANUAL, seen_stops, time.monotonic_ns())
            if press.number <= self._over.get(press.sender, 0):
                raise RefusedError("this hand has let go: let go, then take hold again")
            if press != self._press:
                self._end_press()
                self._press = press
                self._driver = Driver(press.name, time.monotonic_ns())
            if self._orders.mode is not Mode.MANUAL:
                self._orders = orders
                self._board.arm()
            self._manual_until_ns = until_ns
            self._by_hand = duties
            self._board.drive(WheelCommand(duties, until_ns))

    def let_go(self, press: Press) -> None:
        """A hand lets go: what it has sent before and is still on its way moves nothing."""
        with self._lock:
            if press == self._press:
                self._release(time.monotonic_ns())
            else:
                self._is_over(press)

    def steer_by_policy(self, orders: Orders, command: WheelCommand) -> int | None:
        """Drive as the policy decided, unless the orders have changed since it began.

        Returns:
            The ticket of `Board.drive`; None if the decision came too late.

        """
        with self._lock:
            if self._orders != orders:
                return None
            return self._board.drive(command)

    def rest(self, orders: Orders) -> None:
        """Stop the motors while these orders stand, without changing what is wanted."""
        with self._lock:
            if self._orders == orders:
                self._board.stop()

    def end_manual_if_due(self) -> None:
        """A person who has let go has stopped driving."""
        with self._lock:
            self._release_if_due(time.monotonic_ns())

    def _release_if_due(self, now_ns: int) -> None:
        if self._orders.mode is Mode.MANUAL and now_ns >= self._manual_until_ns:
            self._release(now_ns)

    def _release(self, now_ns: int) -> None:
        self._end_press()
        self._orders = self._orders.released(now_ns)
        self._board.disarm()
        self._board.stop()

    def _end_press(self) -> None:
        """Whatever ends a press ends it for good: who still holds has to take hold again."""
        if self._press is not None:
            self._is_over(self._press)
            self._press = None

    def _is_over(self, press: Press) -> None:
        last = self._over.pop(press.sender, 0)
        self._over[press.sender] = max(last, press.number)
        if len(self._over) > MOST_SENDERS:
            del self._over[next(iter(self._over))]
