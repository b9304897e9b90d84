"""Driving by hand: a thread that hands on to the robot what the holding hand said last."""

import threading
import time
from collections.abc import Callable
from typing import Protocol, Self

from mbot_protocol.errors import MbotError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.by_hand.hand import FRESH_S, Grip, Hand, HandRepeat

HOLD_MS = 300
"""Of each command: the robot stops by itself if two in a row are lost, or this process dies."""

Tell = Callable[[int, str], None]
"""Hears which page's drive has ended, and why, in words."""


class HandControl(Protocol):
    """What is used of `RemoteControl`; by this thread only."""

    def catch_up(self, seen_stops: int) -> Status:
        """Learn the robot's clock; refuses where there was another stop."""
        ...

    def drive(self, left: float, right: float, hold_ms: int, press: int) -> str:
        """Drive for so long."""
        ...

    def let_go(self, press: int) -> None:
        """Take no more of this press."""
        ...


class HandDrive:
    """The thread. A context manager; whoever holds at its end is let go of."""

    def __init__(
        self, control: HandControl, tell: Tell, monotonic_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._control = control
        self._tell = tell
        self._monotonic_s = monotonic_s
        self._hand = Hand()
        self._driving: Grip | None = None
        self._presses = 0  # as the robot counts them, for which all pages are one hand
        self._sent_s: float | None = None
        self._news = threading.Condition()
        self._is_news = False
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="hand drive", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._news:
            self._closing = True
            self._hand.let_all_go()
            self._news.notify()
        self._thread.join(timeout=3.0)

    def repeat(self, owner: int, said: HandRepeat) -> str:
        """As `Hand.repeat`; returns at once."""
        with self._news:
            refusal = self._hand.repeat(owner, said, self._monotonic_s())
            self._is_news |= not refusal
            self._news.notify()
        return refusal

    def let_go(self, owner: int, press: int) -> None:
        """As `Hand.let_go`."""
        self._change(lambda: self._hand.let_go(owner, press))

    def holds(self, owner: int) -> bool:
        """Whether it is this page's hand that drives."""
        driving = self._driving
        return driving is not None and driving.owner == owner

    def forget(self, owner: int) -> None:
        """As `Hand.forget`."""
        self._change(lambda: self._hand.forget(owner))

    def let_all_go(self) -> None:
        """As `Hand.let_all_go`: somebody has pressed STOP."""
        self._change(self._hand.let_all_go)

    def step(self) -> None:
        """Tell the robot what has changed since the last step."""
        held = self._held()
        if self._driving is not None and not self._driving.is_same_press(held):
            self._let_robot_go()
        if held is None or held.arrived_s == self._sent_s:
            return
        try:
            if self._driving is None:
                self._control.catch_up(held.seen_stops)
                now_held = self._held()  # that took a while, in which the hand may have let go
                if now_held is None or not now_held.is_same_press(held):
                    return
                held = now_held
                self._presses += 1
            self._sent_s = held.arrived_s
            self._control.drive(held.left, held.right, HOLD_MS, self._presses)
            self._driving = held
        except MbotError as error:
            self._driving = None
            with self._news:
                self._hand.let_go(held.owner)
            self._tell(held.owner, str(error))

    def _let_robot_go(self) -> None:
        self._driving = None
        try:
            self._control.let_go(self._presses)
        except MbotError:
            return  # stopped already, or out of reach: then the last command runs out

    def _held(self) -> Grip | None:
        with self._news:
            return self._hand.held(self._monotonic_s())

    def _change(self, change: Callable[[], None]) -> None:
        with self._news:
            change()
            self._is_news = True
            self._news.notify()

    def _run(self) -> None:
        while True:
            with self._news:
                wait_s = None if self._driving is None else FRESH_S / 5
                self._news.wait_for(lambda: self._is_news or self._closing, wait_s)
                self._is_news = False
                closing = self._closing
            self.step()
            if closing:
                return
