"""Wheels that turn until let go of: said once by the program, repeated by a thread.

Each command holds for 0.5 s, so the robot stops by itself when this process, its computer or the
link dies; two commands in a row may be lost.
"""

import math
import threading
from numbers import Real

from mbot.state import look_again
from mbot_protocol.errors import ConfigurationError, MbotError, RefusedError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.by_hand.hand_session import REPEAT_S
from mbot_workstation.fleet.by_hand.timed_drive import HOLD_MS
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink


class HeldWheels:
    """A hand on the wheels. What has ended, however, turns again only by another `hold`.

    Its end may be a `let_go`, somebody's STOP, or a link that is gone.
    """

    def __init__(self, link: RobotLink) -> None:
        self._control = RemoteControl(link)
        self._turn = threading.Lock()  # one command at a time
        self._wheels: tuple[float, float] | None = None
        self._press = 0
        self._ended_by: MbotError | None = None
        self._over = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._repeat, name="held wheels", daemon=True)

    def hold(self, left: float, right: float, seen: Status) -> None:
        """Turn the wheels from now on; returns when the robot has said that it does.

        Args:
            left, right: wheels in [-1, 1], 1 is full speed forward.
            seen: how the program has last seen the robot.

        Raises:
            ConfigurationError: a wheel is no number in [-1, 1].
            RefusedError: the robot says why not, or was stopped since `seen`.
            UnreachableError: it doesn't answer.

        """
        wheels = _checked(left, "left"), _checked(right, "right")
        with self._turn:
            if self._wheels is None or not self._goes_on(wheels):
                self._take_hold(wheels, seen)
        if not self._thread.is_alive():
            self._thread.start()

    def wait(self, seconds: float) -> None:
        """Wait while they turn; raises what ends that earlier, if it isn't a `let_go`."""
        if self._over.wait(seconds) and self._ended_by is not None:
            raise self._ended_by

    def let_go(self) -> None:
        """Stop the wheels. Without a link they stop when the last command is over."""
        with self._turn:
            if self._wheels is None:
                return
            self._end(None)
            try:
                self._control.let_go(self._press)
            except MbotError:
                return  # stopped already, or out of reach

    def forget(self) -> None:
        """Say nothing more: a STOP is on its way, and waits for nobody's turn."""
        self._end(None)

    def close(self) -> None:
        """Let go, for good."""
        self._closing.set()
        self.let_go()
        if self._thread.is_alive():
            self._thread.join(timeout=3.0)

    def _take_hold(self, wheels: tuple[float, float], seen: Status) -> None:
        look_again(self._control, seen)
        self._press += 1
        self._ended_by = None
        self._over.clear()
        # Before it is sent: whatever interrupts that, `let_go` has something to let go of.
        self._wheels = wheels
        try:
            self._control.drive(*wheels, HOLD_MS, self._press)
        except MbotError as error:
            self._end(error)
            raise

    def _goes_on(self, wheels: tuple[float, float]) -> bool:
        """Other wheels, the same hold; false where that was over, for want of time or by a stop."""
        self._wheels = wheels
        try:
            self._control.drive(*wheels, HOLD_MS, self._press)
        except RefusedError:
            self._end(None)
            return False
        except MbotError as error:
            self._end(error)
            raise
        return True

    def _repeat(self) -> None:
        while not self._closing.wait(REPEAT_S):
            with self._turn:
                if (wheels := self._wheels) is None:
                    continue
                try:
                    self._control.drive(*wheels, HOLD_MS, self._press)
                except MbotError as error:
                    self._end(error)

    def _end(self, why: MbotError | None) -> None:
        self._wheels, self._ended_by = None, why
        self._over.set()


def _checked(value: object, name: str) -> float:
    # True is 1 to Python, and a slip here: full speed.
    if not isinstance(value, bool) and isinstance(value, Real):
        wheel = float(value)
        if math.isfinite(wheel) and -1 <= wheel <= 1:
            return wheel
    raise ConfigurationError(f"{name} is {value!r}, expected a number in [-1, 1]")
