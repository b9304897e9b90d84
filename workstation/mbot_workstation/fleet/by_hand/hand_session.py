"""A person drives a robot with a gamepad or a keyboard until they end it."""

import threading
import time
from collections.abc import Callable

from mbot_protocol.errors import MbotError
from mbot_workstation.fleet.by_hand.hand import HandInput, HandRepeat, Wish
from mbot_workstation.fleet.by_hand.hand_drive import HandDrive
from mbot_workstation.fleet.link.remote_control import MARKED_S, RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink

REPEAT_S = 0.1
_OWNER = 1
MARKED = f"marked: the {MARKED_S:g} s until now were wrong"


class HandSession:
    """Hands on what a `HandInput` wants. A context manager; at its end the robot is stopped.

    While the hand holds, it drives, also instead of a policy. That takes over again only when asked
    to; a STOP by anybody ends the hand's drive, is told, and may be driven on from by a new press.
    """

    def __init__(self, link: RobotLink, say: Callable[[str], None]) -> None:
        self._link = link
        self._say = say
        self._drive = HandDrive(RemoteControl(link), self._ended)
        self._seen_stops = 0
        self._press = 0
        self._holding = False

    def __enter__(self) -> "HandSession":
        """Look at the robot; raises as `RobotLink.query`."""
        self._look()
        self._drive.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._drive.__exit__()
        if self._press:
            self._say(RemoteControl(self._link).stop())

    def follow(self, device: HandInput) -> None:
        """Until the device says that it is over."""
        due_s = time.monotonic()
        while not (wish := device.read(max(0.0, due_s - time.monotonic()))).end:
            is_due = time.monotonic() >= due_s
            if (
                is_due
                or (wish.wheels is None) is self._holding
                or wish.stop
                or wish.run
                or wish.mark
            ):
                due_s = time.monotonic() + REPEAT_S
                self.grant(wish)

    def grant(self, wish: Wish) -> None:
        """Do what is wanted now."""
        if wish.mark:  # beside the hand, whose repeats must not wait for the answer
            threading.Thread(target=self._mark, name="mark", daemon=True).start()
        if wish.stop:
            self._drive.let_all_go()
            self._do(lambda: RemoteControl(self._link).stop())
        elif wish.run:
            self._do(self._run)
        if wish.wheels is None or wish.stop:
            if self._holding:
                self._drive.let_go(_OWNER, self._press)
            # After a STOP what is still held does not begin again.
            self._holding = wish.wheels is not None
            return
        if not self._holding:
            self._press += 1
        self._holding = True
        left, right = wish.wheels
        said = HandRepeat(self._press, left, right, self._seen_stops, time.monotonic())
        self._drive.repeat(_OWNER, said)

    def _mark(self) -> None:
        try:
            RemoteControl(self._link).mark()
            self._say(MARKED)
        except MbotError as error:
            self._say(str(error))

    def _run(self) -> str:
        control = RemoteControl(self._link)
        control.catch_up(self._seen_stops)
        return control.run()

    def _do(self, act: Callable[[], str]) -> None:
        try:
            self._say(act())
            self._look()
        except MbotError as error:
            self._ended(_OWNER, str(error))

    def _look(self) -> None:
        self._seen_stops = self._link.status().last_stop.count

    def _ended(self, _: int, words: str) -> None:
        """Say it; who has read it knows of the stop, and may take hold again."""
        self._say(words)
        try:
            self._look()
        except MbotError as error:
            self._say(str(error))
