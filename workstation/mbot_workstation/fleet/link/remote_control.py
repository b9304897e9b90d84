"""Commands to a robot: run, stop, drive by hand.

A command that arrives late is dangerous: a link that hung for five seconds delivers what was meant
five seconds ago. So each one carries its expiry on the robot's own clock, and the last stop that
its sender knows of: what was sent before somebody's STOP is refused after it. Only STOP never
expires.
"""

import itertools
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass

from mbot_protocol.beat.fields import state_word
from mbot_protocol.errors import MbotError, RefusedError, UnreachableError
from mbot_protocol.v1.messages_pb2 import (
    Command,
    CommandReply,
    Drive,
    Mark,
    Run,
    State,
    Status,
    Stop,
    Wheels,
)
from mbot_protocol.wire.keys import COMMAND, STOP, Topic
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.wording import one_line, stop_words

TIME_TO_LIVE_S = 1.0
"""A command that takes longer than this to arrive is not obeyed any more."""

MARKED_S = 3.0
"""So far back a mark counts: what it takes to see a mistake and to find the button."""

STOP_ATTEMPTS = 3
STOP_TIMEOUT_S = 1.0
STOP_PAUSE_S = 0.3
"""While a link is down a query fails at once; the pause gives it time to come back."""

CONFIRM_ATTEMPTS = 8
CONFIRM_PAUSE_S = 0.05
"""A robot that says it is disarmed waits 80 ms for its board's word, and is asked again for it.
Where the kernel's threads get no time that word has been seen to take 0.4 s."""

BEGIN_WAIT_S = 0.3
"""An armed robot begins at its next beat; the camera's next frame may have to come first."""

LOOK_PAUSE_S = 0.05
SLOWEST_RATE_HZ = 0.5
"""The lowest rate of decisions that a robot can be set to."""


class NotStandingError(MbotError):
    """The robot is disarmed, but its board has not confirmed that the motors are off (exit 1)."""


@dataclass(frozen=True, slots=True)
class RobotClock:
    """The robot's monotonic clock as one Status told it, estimated never to be ahead.

    Attributes:
        robot_ns: what the robot's clock said when it replied.
        arrived_ns: this machine's monotonic clock when the reply had arrived. The robot's was
            further on by then, by the reply's travel, so every expiry is that much early.

    """

    robot_ns: int
    arrived_ns: int

    def expiry_ns(self, now_ns: int, time_to_live_s: float) -> int:
        """The robot's clock `time_to_live_s` after `now_ns` of this machine's monotonic clock."""
        return self.robot_ns + (now_ns - self.arrived_ns) + round(time_to_live_s * 1e9)


class RemoteControl:
    """Commands one robot over a link.

    The robot's session, clock and last stop are asked for once, before the first command that
    expires, and again after a stop of one's own. If the robot restarts meanwhile, or somebody else
    stops it, it refuses further commands: nobody should drive on unawares.
    """

    def __init__(
        self, link: RobotLink, monotonic_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._link = link
        self._monotonic_ns = monotonic_ns
        self._sender_id = secrets.randbits(63) | 1
        self._numbers = itertools.count(1)
        self._seen: tuple[RobotClock, Status] | None = None
        self._presses = 1

    def synchronise(self) -> Status:
        """Learn the robot's session, clock and last stop again; before what may set it in motion.

        Raises:
            UnreachableError: also where a STOP would not get through.
            NewerSchemaError, MalformedMessageError: as `RobotLink.query`.

        """
        if not self._link.reaches(STOP):
            raise UnreachableError(
                f"a STOP does not get through to robot {self._link.robot_id} at "
                f"{self._link.endpoint}, so nothing is sent that sets it in motion: upgrade its "
                "mbot-agent, or connect to the robot itself"
            )
        status = self._link.status()
        self._seen = RobotClock(status.now_monotonic_ns, self._monotonic_ns()), status
        return status

    def catch_up(self, seen_stops: int) -> Status:
        """As `synchronise`, on behalf of somebody who has seen so many stops on a display.

        Raises:
            RefusedError: there has been another one: a look at it comes before what follows.
            UnreachableError, NewerSchemaError, MalformedMessageError: as `RobotLink.query`.

        """
        status = self.synchronise()
        if status.last_stop.count != seen_stops:
            raise RefusedError(
                f"robot {self._link.robot_id}: {stop_words(status)}; look, then do it again"
            )
        return status

    def run(self, *, when_ready: bool = False) -> str:
        """Let the policy drive; the robot's state afterwards, as a word.

        Args:
            when_ready: also if something is in the way now: begin when that is mended.

        Raises:
            RefusedError: the robot says why not.
            UnreachableError, NewerSchemaError, MalformedMessageError: as `RobotLink.query`.

        """
        return self._send(Command(run=Run(when_ready=when_ready)))

    def after_run(self) -> Status:
        """The status once a `run` that was answered with a fault has had the time to take effect.

        A robot that was told to wait shows a fault until its next beat, whether there is one or
        not. Raises as `RobotLink.query`.
        """
        status = self._link.status()
        beat_s = 1 / max(SLOWEST_RATE_HZ, status.decision_rate_hz)
        until_ns = self._monotonic_ns() + round((beat_s + BEGIN_WAIT_S) * 1e9)
        while status.state == State.STATE_FAULT and self._monotonic_ns() < until_ns:
            time.sleep(LOOK_PAUSE_S)
            status = self._link.status()
        return status

    def drive(self, left: float, right: float, hold_ms: int, press: int = 0) -> str:
        """Drive by hand for `hold_ms` (at most 1000); then the robot stops by itself.

        Args:
            left, right: wheels in [-1, 1], 1 is full speed forward.
            hold_ms: how long this command holds; it is not obeyed later than that either.
            press: which time that this hand has taken hold; once a press is over (let go, or none
                of its commands for as long as one holds), the robot takes no more of it. Without
                one it is the time since the last `stop`.

        Raises:
            RefusedError, UnreachableError, ...: as `run`.

        """
        wheels = Wheels(left=left, right=right)
        drive = Drive(wheels=wheels, hold_ms=hold_ms, press=press or self._presses)
        return self._send(Command(drive=drive), min(TIME_TO_LIVE_S, hold_ms / 1000))

    def let_go(self, press: int) -> None:
        """The hand has let go: what it has said before and is on its way moves nothing.

        It disarms without being a STOP, which would count, and be somebody's name in everybody's
        log at each key that is lifted.

        Raises:
            RefusedError, UnreachableError, ...: as `run`.

        """
        # A robot of before there were presses sees wheels at zero, over at once.
        self._send(Command(drive=Drive(wheels=Wheels(), hold_ms=1, press=press, let_go=True)))

    def mark(self, back_s: float = MARKED_S) -> None:
        """Note in the robot's recording that what it has just done was wrong; it drives on.

        Raises:
            RefusedError, UnreachableError, ...: as `run`.

        """
        self._send(Command(mark=Mark(back_ms=round(back_s * 1000))))

    def stop(self) -> str:
        """Stop the motors. Needs no status before, never expires, and does not give up at once.

        Raises:
            UnreachableError: no reply to three of them, so the robot may still be driving.
            NotStandingError: the robot is disarmed, but eight times its board did not confirm.

        """
        self._seen = None  # whatever comes after this has to look first
        self._presses += 1  # and to take hold again
        unheard = unconfirmed = 0
        while True:
            try:
                # On a key of its own, open to everybody who may look.
                reply = self._ask(STOP, Command(stop=Stop()), STOP_TIMEOUT_S)
            except UnreachableError as error:
                unheard += 1
                if unheard == STOP_ATTEMPTS:
                    raise UnreachableError(
                        "STOP was not confirmed, the robot may be driving; switch it off by hand: "
                        f"{error}"
                    ) from None
                time.sleep(STOP_PAUSE_S)
                continue
            if reply.standing:
                return state_word(reply.state)
            unconfirmed += 1
            if unconfirmed == CONFIRM_ATTEMPTS:
                raise NotStandingError(
                    f"robot {self._link.robot_id} has not confirmed that it has stopped: "
                    f"{one_line(reply.reason) or 'it does not say why, upgrade its mbot-agent'}; "
                    "switch it off by hand"
                )
            time.sleep(CONFIRM_PAUSE_S)

    def _send(self, command: Command, good_for_s: float = TIME_TO_LIVE_S) -> str:
        if self._seen is None:
            self.synchronise()
        assert self._seen is not None
        clock, status = self._seen
        command.session_id = status.session_id
        command.expires_monotonic_ns = clock.expiry_ns(self._monotonic_ns(), good_for_s)
        command.stop_count = status.last_stop.count
        command.sender_id = self._sender_id
        command.number = next(self._numbers)
        return state_word(self._ask(COMMAND, command, TIME_TO_LIVE_S + 1.0).state)

    def _ask(self, topic: Topic, command: Command, timeout_s: float) -> CommandReply:
        command.schema_version = SCHEMA_VERSION
        command.robot_id = self._link.robot_id
        command.sender = self._link.sender
        reply = self._link.query(topic, command, CommandReply, timeout_s)
        if not reply.accepted:
            raise RefusedError(f"robot {self._link.robot_id} refused: {one_line(reply.reason)}")
        return reply
