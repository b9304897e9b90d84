"""Commands to a robot: run, stop, drive by hand.

A command that arrives late is dangerous: a link that hung for five seconds delivers what was meant
five seconds ago. So each one carries its expiry on the robot's own clock; only STOP never expires.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from mbot_protocol.errors import RefusedError, UnreachableError
from mbot_protocol.keys import COMMAND, STOP, Topic
from mbot_protocol.schema import SCHEMA_VERSION
from mbot_protocol.v1.messages_pb2 import (
    Command,
    CommandReply,
    Drive,
    Run,
    Status,
    Stop,
    Wheels,
)
from mbot_workstation.link.robot_link import RobotLink
from mbot_workstation.wording import one_line, state_word

TIME_TO_LIVE_S = 1.0
"""A command that takes longer than this to arrive is not obeyed any more."""

STOP_ATTEMPTS = 3
STOP_TIMEOUT_S = 1.0
STOP_PAUSE_S = 0.3
"""While a link is down a query fails at once; the pause gives it time to come back."""


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

    The robot's session and clock are asked for once, before the first command that expires. If
    the robot restarts meanwhile it refuses further commands: nobody should drive on unawares.
    """

    def __init__(
        self, link: RobotLink, monotonic_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._link = link
        self._monotonic_ns = monotonic_ns
        self._session_id = 0
        self._clock: RobotClock | None = None

    def synchronise(self) -> Status:
        """Learn the robot's session and clock anew; raises as `RobotLink.query` does."""
        status = self._link.status()
        self._clock = RobotClock(status.now_monotonic_ns, self._monotonic_ns())
        self._session_id = status.session_id
        return status

    def run(self) -> str:
        """Let the policy drive; the robot's state afterwards, as a word.

        Raises:
            RefusedError: the robot says why not.
            UnreachableError, NewerSchemaError, MalformedMessageError: as `RobotLink.query`.

        """
        return self._send(Command(run=Run()))

    def drive(self, left: float, right: float, hold_ms: int) -> str:
        """Drive by hand for `hold_ms` (at most 1000); then the robot stops by itself.

        Args:
            left, right: wheels in [-1, 1], 1 is full speed forward.
            hold_ms: how long this command holds.

        Raises:
            RefusedError, UnreachableError, ...: as `run`.

        """
        wheels = Wheels(left=left, right=right)
        return self._send(Command(drive=Drive(wheels=wheels, hold_ms=hold_ms)))

    def stop(self) -> str:
        """Stop the motors. Needs no status before, never expires, and is tried three times.

        Raises:
            UnreachableError: no reply, so the robot may still be driving.

        """
        for attempt in range(1, STOP_ATTEMPTS + 1):
            try:
                # On a key of its own, open to everybody who may look.
                return self._ask(STOP, Command(stop=Stop()), STOP_TIMEOUT_S)
            except UnreachableError as error:
                if attempt == STOP_ATTEMPTS:
                    raise UnreachableError(
                        f"STOP was not confirmed, the robot may be driving; switch it off by "
                        f"hand: {error}"
                    ) from None
                time.sleep(STOP_PAUSE_S)
        raise AssertionError("unreachable")

    def _send(self, command: Command) -> str:
        if self._clock is None:
            self.synchronise()
        assert self._clock is not None
        command.session_id = self._session_id
        command.expires_monotonic_ns = self._clock.expiry_ns(self._monotonic_ns(), TIME_TO_LIVE_S)
        return self._ask(COMMAND, command, TIME_TO_LIVE_S + 1.0)

    def _ask(self, topic: Topic, command: Command, timeout_s: float) -> str:
        command.schema_version = SCHEMA_VERSION
        command.robot_id = self._link.robot_id
        reply = self._link.query(topic, command, CommandReply, timeout_s)
        if not reply.accepted:
            raise RefusedError(f"robot {self._link.robot_id} refused: {one_line(reply.reason)}")
        return state_word(reply.state)
