"""The motor thread: the only place that talks to the board, and the last word on safety.

A drive command holds only until its deadline and only while its guard says so; it is refreshed
at 10 Hz, and when either fails the motors are stopped here, whatever the rest of the daemon does.
"""

import contextlib
import logging
import os
import threading
import time
from typing import Self

from mbot_agent.board import board_kinds
from mbot_agent.board.board_session import (
    BoardLostError,
    BoardResetError,
    BoardSession,
    Firmware,
    UnacknowledgedError,
)
from mbot_agent.board.told_senses import ToldSenses
from mbot_agent.configuration import NOTHING_READ, BoardSettings, SensesSettings
from mbot_agent.faults import Fault, Notice
from mbot_agent.hardware import Delivery
from mbot_protocol.back_off import BackOff
from mbot_protocol.drive.actions import AS_BUILT, WheelMaps
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import STOP, WheelCommand
from mbot_protocol.errors import UnreachableError

log = logging.getLogger(__name__)

REFRESH_S = 0.1
"""Drive commands are repeated at 10 Hz: three times within the firmware's 300 ms time-out, far
below the 400 Hz at which the board's parser starts to fail (measured)."""

IDLE_HEARTBEAT_S = 0.5
"""While standing, STOP is repeated this often: it keeps the last word a stop and finds a dead
board before it is needed."""

LATCHED_AFTER_REFUSALS = 2
"""Drive commands that were not acknowledged, though the stops between them were."""

LOST_AFTER_FAILURES = 2
"""The same in a row, of firmware that never latches: its port is closed and reopened."""


class Motors:
    """Owns the serial port in a thread of its own. Use as a context manager.

    Attributes:
        progress_ns: when the thread was last seen to work, monotonic.

    """

    def __init__(
        self,
        board: BoardSettings,
        wheels: WheelMaps = AS_BUILT,
        senses: SensesSettings = NOTHING_READ,
    ) -> None:
        """`wheels` say which motor is reversed, `senses` what the board is to feel.

        Raises:
            ConfigurationError: nobody knows this kind of board.

        """
        self._board = board
        self._wheels = wheels
        self._senses_settings = senses
        self._told = ToldSenses(senses)
        self._open = board_kinds.opener(board)
        self._news = threading.Condition()
        self._command: WheelCommand | None = None
        self._fresh = False  # the command has not been written yet
        self._delivery: tuple[int, Delivery] | None = None  # the last one, and its ticket
        self._ticket = 0
        self._halted = False
        self._resets = 0
        self._arm = False  # ARM is to be sent before the next command
        self.progress_ns = time.monotonic_ns()
        self._asked_to_stand = False
        self._stood_ns = 0  # when a stop was last written that the board has acknowledged
        self._closing = False
        self._stopped = threading.Event()
        self._fault: Fault | None = Fault("board-starting", "the board has not answered yet")
        self._firmware = Firmware()
        self._wake_reader, self._wake_writer = os.pipe()
        os.set_blocking(self._wake_reader, False)
        os.set_blocking(self._wake_writer, False)
        self._thread = threading.Thread(target=self._run, name="motors", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._closing = True
        self.halt()
        self._thread.join(timeout=2.0)

    @property
    def version(self) -> str:
        """The firmware's name of itself; empty while not connected."""
        return self._firmware.version

    @property
    def resets(self) -> int:
        """How often the board has reset or latched by itself since the daemon's start."""
        return self._resets

    @property
    def has_deadman(self) -> bool:
        """Whether the firmware stops by itself when commands cease."""
        return self._firmware.has_deadman

    @property
    def senses(self) -> Senses | None:
        """What the board feels; None: it tells nothing of it."""
        return self._told.latest

    @property
    def edges(self) -> int:
        """How often the board has begun to hold back for want of floor."""
        return self._told.edges

    @property
    def notices(self) -> tuple[Notice, ...]:
        """What is worth knowing of the board."""
        return self._told.notices

    @property
    def fault(self) -> Fault | None:
        """Why the wheels cannot be driven now, if they cannot."""
        fault, firmware = self._fault or self._told.fault, self._firmware
        if fault is None and firmware.mistaken:
            return Fault("board-other", firmware.mistaken)
        if fault is None and not (firmware.has_deadman or self._board.accept_no_deadman):
            return Fault(
                "board-no-deadman",
                f"the board ({firmware.version}) keeps driving if this computer dies; use one "
                "with a time-out, or accept it by board.accept_no_deadman = true",
            )
        return fault

    def arm(self) -> None:
        """A person wants to drive: a board that has latched may be told so, once."""
        with self._news:
            self._arm = True

    def disarm(self) -> None:
        """Nobody wants to drive any more: what `arm` left to be said must not be said."""
        with self._news:
            self._arm = False

    def drive(self, command: WheelCommand) -> int:
        """Make this the command in force. Returns a ticket for `delivery`.

        A command given while the motors cannot be driven is dropped, never kept for later.
        """
        with self._news:
            self._ticket += 1
            if not self._halted and self.fault is None:  # else there is no other one either
                self._command, self._fresh = command, True
            ticket = self._ticket
        self._wake()
        return ticket

    def delivery(self, ticket: int, timeout_s: float) -> Delivery | None:
        """Wait for a command's acknowledgement; None if it does not come in time."""
        with self._news:
            self._news.wait_for(lambda: self._delivered_ticket() >= ticket, timeout_s)
            if self._delivery is None or self._delivery[0] != ticket:
                return None
            return self._delivery[1]

    def _delivered_ticket(self) -> int:
        return self._delivery[0] if self._delivery is not None else 0

    def stop(self) -> None:
        """End any command; the thread stops the motors at once if they were driven."""
        with self._news:
            if self._command is None:
                return
            self._command = None
        self._wake()

    def stands(self, timeout_s: float) -> bool:
        """Whether the board acknowledges, from now on and within the time, that its motors are off;
        false at once if it is lost.
        """
        asked_ns = time.monotonic_ns()
        with self._news:
            self._asked_to_stand = True
        self._wake()
        with self._news:
            self._news.wait_for(
                lambda: self._stood_ns >= asked_ns or self._fault is not None, timeout_s
            )
            return self._stood_ns >= asked_ns

    def halt(self) -> None:
        """Stop now and accept no command ever after: the daemon is going down."""
        with self._news:
            self._halted = True
            self._command = None
        self._wake()

    def wait_stopped(self, timeout_s: float) -> bool:
        """Whether the board has confirmed a stop (or is not connected) within the time."""
        return self._stopped.wait(timeout_s)

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):  # the pipe is full of wake-ups already
            os.write(self._wake_writer, b"x")

    def _sleep(self, seconds: float) -> None:
        """Wait without a board, unless the daemon closes."""
        end = time.monotonic() + seconds
        while not self._closing and (left := end - time.monotonic()) > 0:
            self.progress_ns = time.monotonic_ns()
            time.sleep(min(left, 0.05))

    def _run(self) -> None:
        back_off = BackOff()
        while not self._closing:
            try:
                with self._open(self._board, self._wake_reader) as session:
                    while not self._closing and session.handshake(self._gives_up):
                        back_off.succeeded()
                        watched = session.watch(self._senses_settings, self._wheels)
                        self._told.connected(session.firmware.version, watched=watched)
                        self._connected(session)
                        try:
                            self._serve(session)
                        except BoardResetError as error:
                            self._resets += 1
                            self._lost(error)  # the port still stands: shake hands again
            except UnreachableError as error:
                self._lost(error)
                self._stopped.set()  # there is nothing left that could be waited for
                self._sleep(back_off.next_s())
            except Exception as error:
                log.exception("the motor thread stumbled; reopening the board")
                self._lost(UnreachableError(f"internal error: {error}"))
                self._stopped.set()
                self._sleep(back_off.next_s())

    def _gives_up(self) -> bool:
        """Whether the handshake shall end; it asks five times a second."""
        self.progress_ns = time.monotonic_ns()
        return self._closing

    def _connected(self, session: BoardSession) -> None:
        with self._news:
            self._firmware, self._command, self._fault = session.firmware, None, None
        log.info("board ready on %s, firmware %s", session.path, session.firmware.version)
        if (fault := self.fault) is not None:
            log.warning("%s", fault.detail)

    def _lost(self, error: Exception) -> None:
        fault = Fault("board-lost", str(error))
        if self._fault != fault:
            log.warning("%s", error)
        with self._news:
            self._fault, self._firmware, self._command = fault, Firmware(), None
            self._arm = False
            self._told.lost()
            self._news.notify_all()

    def _serve(self, session: BoardSession) -> None:
        """Keep the board doing what is in force until the daemon closes or the board is lost."""
        driving = False
        next_write = 0.0
        failures = refused = 0
        while not self._closing:
            self.progress_ns = time.monotonic_ns()
            self._told.take(session.senses)
            command, ticket, fresh = self._in_force()
            now = time.monotonic()
            try:
                if command is None:
                    if driving or self._is_asked_to_stand():
                        self._stop(session)
                        driving = False
                        next_write = now + IDLE_HEARTBEAT_S
                    elif now >= next_write:
                        session.send(STOP)
                        next_write = now + IDLE_HEARTBEAT_S
                    self._stopped.set()
                elif fresh or now >= next_write:
                    driving = driving or not command.duties.is_stop
                    if self._is_to_be_armed():
                        session.arm()
                    written_ns, acknowledged_ns = session.send(
                        self._wheels.at_motors(command.duties)
                    )
                    refused = 0
                    next_write = now + REFRESH_S
                    if fresh:
                        self._delivered(ticket, Delivery(written_ns, acknowledged_ns))
                failures = 0
            except UnacknowledgedError as error:
                failures += 1
                refused += command is not None
                if failures >= LOST_AFTER_FAILURES and not session.firmware.may_latch:
                    raise BoardLostError(str(error)) from None
                self._drop(ticket)
                # It may or may not have obeyed. Stop it for certain before anything newer is sent;
                # a board that does not acknowledge that is lost.
                self._stop(session)
                driving = False
                if refused >= LATCHED_AFTER_REFUSALS and session.firmware.may_latch:
                    # It obeys stops and no drive command: its dead man's switch has latched.
                    self._resets, refused = self._resets + 1, 0
                continue
            self._wait(session, command, next_write)

    def _in_force(self) -> tuple[WheelCommand | None, int, bool]:
        """The command that holds now, its ticket, and whether it still has to be written."""
        with self._news:
            command, fresh = self._command, self._fresh
            self._fresh = False
            if command is not None and (
                time.monotonic_ns() >= command.deadline_ns or not command.guard()
            ):
                self._command = command = None
            if command is not None:
                self._stopped.clear()
            return command, self._ticket, fresh

    def _is_asked_to_stand(self) -> bool:
        with self._news:
            asked, self._asked_to_stand = self._asked_to_stand, False
            return asked

    def _is_to_be_armed(self) -> bool:
        with self._news:
            arm, self._arm = self._arm, False
            return arm

    def _stop(self, session: BoardSession) -> None:
        began_ns = time.monotonic_ns()
        session.stop()
        with self._news:
            self._stood_ns = began_ns
            self._news.notify_all()

    def _drop(self, ticket: int) -> None:
        """Forget a command, unless a newer one has come meanwhile."""
        with self._news:
            if self._ticket == ticket:
                self._command = None

    def _delivered(self, ticket: int, delivery: Delivery) -> None:
        with self._news:
            self._delivery = ticket, delivery
            self._news.notify_all()

    def _wait(self, session: BoardSession, command: WheelCommand | None, next_write: float) -> None:
        until = next_write
        if command is not None:
            until = min(until, command.deadline_ns / 1e9)
        session.wait(until - time.monotonic())
        with contextlib.suppress(BlockingIOError):
            while os.read(self._wake_reader, 64):
                pass
