"""A session of maneuvers: count down, drive, keep; pause, repeat, quit."""

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from mbot_protocol.errors import MbotError, RefusedError, UnreachableError
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.measure.maneuvers.maneuver_drive import (
    RobotTime,
    SpoiltRunError,
    drive_maneuver,
    measure_robot_time,
)
from mbot_workstation.measure.maneuvers.plan import Planned
from mbot_workstation.measure.maneuvers.session_journal import Journal
from mbot_workstation.measure.maneuvers.terminal import Keyboard, NoKeys, PlainDisplay
from mbot_workstation.measure.tracks.maneuver import maneuver_named

LOOK_S = 0.05
"""How often keys are looked at."""

SPOILT_AT_MOST = 3
"""In a row, unattended. A link may hang for a moment; three times it is something else."""

CLOCK_JUMP_NS = 1_000_000_000
"""A drifting clock moves by milliseconds between runs; one that started over by far more."""


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """How to drive.

    Attributes:
        seconds: each maneuver.
        pause_s: countdown before each.
        attended: somebody sits at the keyboard; otherwise spoilt runs are driven again by
            themselves, a few times.

    """

    seconds: float
    pause_s: float
    attended: bool


class _QuitError(Exception):
    """Somebody has had enough."""


class Session:
    """Drives what is planned and not recorded yet."""

    def __init__(
        self,
        link: RobotLink,
        journal: Journal,
        plan: Sequence[Planned],
        settings: SessionSettings,
        keys: NoKeys | Keyboard,
        display: PlainDisplay,
    ) -> None:
        self._link = link
        self._control = RemoteControl(link)
        self._journal = journal
        done = journal.recorded
        self._total = len(plan)
        self._waiting = deque(
            run for run in plan if (run.maneuver.name, run.repetition) not in done
        )
        self._settings = settings
        self._keys = keys
        self._display = display
        self._clock: RobotTime | None = None
        self._spoilt_in_a_row = 0

    def run(self) -> bool:
        """Drive all; False if somebody quit before the end.

        Raises:
            SpoiltRunError: unattended, and a run was spoilt three times.
            UnreachableError, RefusedError: unattended, and the robot did not answer or said no.
            KeyboardInterrupt: Ctrl-C; the robot has been stopped.

        """
        try:
            while self._waiting:
                self._one()
        except _QuitError:
            return False
        return True

    def _one(self) -> None:
        run = self._waiting[0]
        self._display.next_run(run, self._total - len(self._waiting), self._total)
        if not self._count_down():
            return  # another run comes first now
        number = self._journal.next_number()
        try:
            clock = self._synchronise()
            while self._keys.pressed() is not None:
                pass  # pressed before it was announced: not meant for this drive
            self._display.driving()
            driven = drive_maneuver(
                self._control,
                clock,
                run.maneuver,
                run.maneuver.duration_s(self._settings.seconds),
                self._stop_wanted,
            )
        except (SpoiltRunError, UnreachableError, RefusedError) as error:
            self._spoilt(run, error)
            return
        self._waiting.popleft()
        self._spoilt_in_a_row = 0
        self._journal.add(number, run.maneuver, run.repetition, driven.series, driven.uncertainty_s)
        self._display.recorded(run, number)

    def _synchronise(self) -> RobotTime:
        self._control.synchronise()
        clock = measure_robot_time(self._link)
        if self._clock and abs(clock.ahead_ns - self._clock.ahead_ns) > CLOCK_JUMP_NS:
            raise MbotError(
                "the robot's clock started over: it was restarted; what was recorded is kept, "
                "record the rest into a new folder"
            )
        self._clock = clock
        return clock

    def _spoilt(self, run: Planned, error: MbotError) -> None:
        """Tell, and wait until somebody has put it right."""
        self._spoilt_in_a_row += 1
        if not self._settings.attended and (
            self._spoilt_in_a_row >= SPOILT_AT_MOST or not isinstance(error, SpoiltRunError)
        ):
            raise error
        name = f"{run.maneuver.name}, repetition {run.repetition}"
        self._display.say(f"{name} was spoilt and is not kept: {error}")
        if self._settings.attended:
            self._pause("it will be driven again")

    def _count_down(self) -> bool:
        """Whether the run that was announced is to be driven now."""
        until_s = time.monotonic() + self._settings.pause_s
        while (left_s := until_s - time.monotonic()) > 0:
            self._display.countdown(left_s)
            key = self._keys.pressed()
            if key in ("p", "enter", " "):
                self._pause("paused")
                until_s = time.monotonic() + self._settings.pause_s
            elif key == "r" and self._repeat():
                return False
            elif key == "q":
                raise _QuitError
            time.sleep(min(LOOK_S, left_s))
        return True

    def _pause(self, why: str) -> None:
        self._display.say(
            f"{why}; put the robot in its place. Enter goes on, r repeats the last, q quits"
        )
        while True:
            key = self._keys.pressed()
            if key in ("p", "enter", " "):
                return
            if key == "q":
                raise _QuitError
            if key == "r":
                self._repeat()
                return
            time.sleep(LOOK_S)

    def _repeat(self) -> bool:
        run = self._journal.remove_last()
        if run is None:
            self._display.say("nothing has been recorded that could be repeated")
            return False
        self._waiting.appendleft(Planned(maneuver_named(run.maneuver), run.repetition))
        self._display.say(f"run {run.number} ({run.maneuver}) is forgotten and driven again")
        return True

    def _stop_wanted(self) -> bool:
        """Any key stops a drive: nobody should have to find the right one."""
        return self._keys.pressed() is not None


def check_ready(link: RobotLink) -> None:
    """Whether the robot can be driven by hand now.

    Raises:
        RefusedError: a policy is driving it, or its board is not ready.

    """
    from mbot_protocol.v1.messages_pb2 import State
    from mbot_workstation.wording import fault_lines

    status = link.status()
    if status.state == State.STATE_RUNNING:
        raise RefusedError(f"a policy is driving {link.robot_id}: `workstation stop` first")
    board = [fault for fault in status.faults if fault.kind.startswith("board")]
    if board:
        raise RefusedError(f"{link.robot_id} can't drive: {fault_lines(board)[0]}")
