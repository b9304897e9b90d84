"""The helm: who drives, and the lock that makes a change of mind final.

The control loop and the command service both move the wheels, but only through here: once
`stop` has returned, no decision begun before it can reach a motor.
"""

import threading
import time
from dataclasses import dataclass
from enum import Enum

from mbot_agent.faults import Fault
from mbot_agent.motors import DriveCommand, Motors
from mbot_protocol.mcore import Joystick


class Mode(Enum):
    """What a person, or the configuration, wants."""

    IDLE = "idle"
    RUNNING = "running"
    STOPPED = "stopped"
    MANUAL = "manual"


class State(Enum):
    """What the robot does: its mode, or `fault` where it should drive and cannot."""

    IDLE = "idle"
    RUNNING = "running"
    STOPPED = "stopped"
    MANUAL = "manual"
    FAULT = "fault"


def state_of(mode: Mode, faults: tuple[Fault, ...]) -> State:
    """The state that follows from what is wanted and what is wrong."""
    if faults and mode in (Mode.RUNNING, Mode.MANUAL):
        return State.FAULT
    return State(mode.value)


@dataclass(frozen=True, slots=True)
class Orders:
    """A mode and the number of changes before it: orders with another number are outdated."""

    mode: Mode
    epoch: int


class Helm:
    """Keeps the mode and hands commands to the motors under one lock."""

    def __init__(self, motors: Motors, mode: Mode) -> None:
        self._motors = motors
        self._lock = threading.Lock()
        self._orders = Orders(mode, 0)
        self._manual_until_ns = 0

    @property
    def orders(self) -> Orders:
        """What is wanted now."""
        return self._orders

    def run(self) -> None:
        """Let the policy drive."""
        with self._lock:
            if self._orders.mode is Mode.MANUAL:
                self._motors.stop()
            self._change(Mode.RUNNING)

    def stop(self) -> None:
        """Stop, and stay so until told otherwise."""
        with self._lock:
            self._change(Mode.STOPPED)
            self._motors.stop()

    def steer_by_hand(self, joystick: Joystick, hold_ns: int) -> None:
        """Drive as a person says, for so long at most."""
        with self._lock:
            if self._orders.mode is not Mode.MANUAL:
                self._change(Mode.MANUAL)
            self._manual_until_ns = time.monotonic_ns() + hold_ns
            self._motors.drive(DriveCommand(joystick, self._manual_until_ns))

    def steer_by_policy(self, orders: Orders, command: DriveCommand) -> int | None:
        """Drive as the policy decided, unless the orders have changed since it began.

        Returns:
            The ticket of `Motors.drive`; None if the decision came too late.

        """
        with self._lock:
            if self._orders != orders:
                return None
            return self._motors.drive(command)

    def rest(self, orders: Orders) -> None:
        """Stop the motors while these orders stand, without changing what is wanted."""
        with self._lock:
            if self._orders == orders:
                self._motors.stop()

    def end_manual_if_due(self) -> None:
        """A person who has let go has stopped driving."""
        with self._lock:
            over = time.monotonic_ns() >= self._manual_until_ns
            if self._orders.mode is Mode.MANUAL and over:
                self._change(Mode.STOPPED)
                self._motors.stop()

    def _change(self, mode: Mode) -> None:
        self._orders = Orders(mode, self._orders.epoch + 1)
