"""The helm: who drives, and the lock that makes a change of mind final.

The control loop and the command service both move the wheels, but only through here: once
`stop` has returned, no decision begun before it can reach a motor.
"""

import threading
import time

from mbot_agent.arming import Mode, Orders
from mbot_agent.hardware import Board, DriveCommand
from mbot_protocol.mcore import Joystick


class Helm:
    """Keeps the mode and hands commands to the board under one lock."""

    def __init__(self, board: Board, mode: Mode) -> None:
        self._board = board
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
                self._board.stop()
            self._change(Mode.RUNNING)

    def stop(self) -> None:
        """Stop, and stay so until told otherwise."""
        with self._lock:
            self._change(Mode.STOPPED)
            self._board.stop()

    def steer_by_hand(self, joystick: Joystick, hold_ns: int) -> None:
        """Drive as a person says, for so long at most."""
        with self._lock:
            if self._orders.mode is not Mode.MANUAL:
                self._change(Mode.MANUAL)
            self._manual_until_ns = time.monotonic_ns() + hold_ns
            self._board.drive(DriveCommand(joystick, self._manual_until_ns))

    def steer_by_policy(self, orders: Orders, command: DriveCommand) -> int | None:
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
            over = time.monotonic_ns() >= self._manual_until_ns
            if self._orders.mode is Mode.MANUAL and over:
                self._change(Mode.STOPPED)
                self._board.stop()

    def _change(self, mode: Mode) -> None:
        self._orders = Orders(mode, self._orders.epoch + 1)
