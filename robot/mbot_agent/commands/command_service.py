"""Answers `status` and `command`: who asks to drive, and may that request still be obeyed?"""

import time
from collections.abc import Callable

from mbot_agent import installed_version
from mbot_agent.arming import Mark, Mode, state_of
from mbot_agent.commands.stop_service import name_in_a_line
from mbot_agent.configuration import Configuration, shown_source
from mbot_agent.control_loop import ControlLoop
from mbot_agent.faults import Notice
from mbot_agent.hardware import Board
from mbot_agent.helm import Helm, Press
from mbot_agent.network.sender_numbers import SenderNumbers
from mbot_agent.network.wire_messages import (
    WIRE_STATES,
    wire_faults,
    wire_motor,
    wire_notices,
    wire_senses,
    wire_stop,
)
from mbot_agent.network.zenoh_link import Link, Listener
from mbot_agent.releases.own_release import own_release
from mbot_protocol.drive.actions import to_steps
from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire import keys
from mbot_protocol.wire.schema import SCHEMA_VERSION, decode

LONGEST_HOLD_MS = 1000
"""A hand-driven command holds no longer than this without being renewed."""

LONGEST_MARK_MS = 10_000
"""What a person still has before their eyes when they say that it was wrong."""

LONGEST_EXPIRY_NS = 2_000_000_000
"""A command that would be good for longer is refused: nobody may keep one for later."""

CLOCK_SLACK_NS = 100_000_000
"""Two clocks that drift apart by 100 millionths of a second each second (a cheap quartz) are so far
apart after a quarter of an hour of one `workstation drive`."""

FORGIVEN_WAIT_S = 0.3
"""After `run` has forgiven a camera its still picture the next frame must show that it is good."""


class CommandService:
    """Turns messages into orders for the helm. Used by two threads; all state is the helm's."""

    def __init__(
        self,
        configuration: Configuration,
        session_id: int,
        helm: Helm,
        board: Board,
        loop: ControlLoop,
        active_model: Callable[[], messages.Model | None],
        notices: Callable[[], tuple[Notice, ...]],
        heard: Callable[[], None],
        updating: Callable[[], bool] = lambda: False,
    ) -> None:
        """`heard` learns of every command that is obeyed; while `updating`, none sets in motion."""
        self._version = installed_version()
        self._release = own_release()
        self._robot_id = configuration.robot_id
        self._camera_source = shown_source(configuration.camera.source)
        self._trust = configuration.trust
        self._rate_hz = configuration.control.decision_rate_hz
        self._wheels = configuration.motors
        self._session_id = session_id
        self._helm = helm
        self._board = board
        self._loop = loop
        self._active_model = active_model
        self._notices = notices
        self._heard = heard
        self._updating = updating
        self._numbers = SenderNumbers()

    def serve(self, link: Link) -> list[Listener]:
        """Answer from now on: a status behind no command, and the other way round."""
        return [
            *link.serve({keys.STATUS.name: self.status}),
            *link.serve({keys.COMMAND.name: self.command}),
        ]

    def status(self, _: bytes) -> bytes:
        """Reply to a query on `status`."""
        latest = self._loop.latest
        orders = self._helm.orders
        faults = self._loop.faults(orders.mode)
        senses = self._board.senses
        return messages.Status(
            schema_version=SCHEMA_VERSION,
            robot_id=self._robot_id,
            session_id=self._session_id,
            now_monotonic_ns=time.monotonic_ns(),
            state=WIRE_STATES[state_of(orders.mode, faults)],
            faults=wire_faults(faults),
            software_version=self._version,
            board_version=self._board.version,
            board_has_deadman=self._board.has_deadman,
            decision_rate_hz=self._rate_hz,
            active_model=self._active_model(),
            missed_ticks=latest.missed_ticks if latest is not None else 0,
            decisions=latest.sequence + 1 if latest is not None else 0,
            camera=self._camera_words(),
            notices=wire_notices(self._notices()),
            trusted_keys=[key.line for key in self._trust.public_keys],
            accepts_unsigned_models=self._trust.allow_unsigned,
            left_motor=wire_motor(self._wheels.left),
            right_motor=wire_motor(self._wheels.right),
            last_stop=wire_stop(orders.stop),
            release=self._release,
            let_go_monotonic_ns=orders.let_go_ns,
            senses=wire_senses(senses) if senses is not None else None,
        ).SerializeToString()

    def _camera_words(self) -> str:
        light = self._loop.light
        return self._camera_source + ("" if light == "unknown" else f", light {light}")

    def command(self, payload: bytes) -> bytes:
        """Reply to a query on `command`, after carrying it out or refusing it."""
        reply = messages.CommandReply(schema_version=SCHEMA_VERSION)
        try:
            command = decode(messages.Command, payload, "the workstation")
            self._obey(command)
            reply.accepted = True
        except MbotError as error:
            reply.reason = str(error)
        orders = self._helm.orders
        reply.state = WIRE_STATES[state_of(orders.mode, self._loop.faults(orders.mode))]
        reply.stop_count = orders.stop.count
        return reply.SerializeToString()

    def _obey(self, command: messages.Command) -> None:
        if command.robot_id != self._robot_id:
            raise RefusedError(
                f"the command is for robot {command.robot_id!r}, this one is {self._robot_id!r}"
            )
        action = command.WhichOneof("action")
        if action == "stop":
            self._helm.stop(name_in_a_line(command.sender))  # however late: it is always right
            return
        self._check_current(command)
        if action == "mark":
            self._mark(command)
            return
        if self._updating():
            raise RefusedError("an update of mbot-agent is under way: wait for its end")
        self._heard()
        if action == "run":
            self._run(command.stop_count, when_ready=command.run.when_ready)
        elif action == "drive":
            self._drive(command)
        else:
            raise RefusedError("the command has no action this robot knows: upgrade mbot-agent")

    def _check_current(self, command: messages.Command) -> None:
        """Refuse what was meant for another moment."""
        if command.session_id != self._session_id:
            raise RefusedError("the command is from before the robot's last start: send it again")
        late_ns = time.monotonic_ns() - command.expires_monotonic_ns
        if late_ns > 0:
            raise RefusedError(
                f"the command expired {late_ns / 1e6:.0f} ms before it arrived: the link is slow"
            )
        if -late_ns > LONGEST_EXPIRY_NS:
            raise RefusedError(
                f"the command is good for {-late_ns / 1e9:.1f} s, expected at most "
                f"{LONGEST_EXPIRY_NS / 1e9:.0f} s"
            )
        self._numbers.take(command.sender_id, command.number)

    def _run(self, seen_stops: int, *, when_ready: bool) -> None:
        """Let the policy drive. With a fault in the way nothing is armed, unless told to wait."""
        self._loop.forgive()
        if when_ready:
            self._helm.run(seen_stops, when_ready=True)
            return
        give_up_s = time.monotonic() + FORGIVEN_WAIT_S
        while (faults := self._loop.faults(Mode.RUNNING)) and time.monotonic() < give_up_s:
            time.sleep(0.01)
        if faults:
            found = "; ".join(fault.detail for fault in faults)
            raise RefusedError(f"not armed: {found} (`run --when-ready` waits for that)")
        self._helm.run(seen_stops)

    def _mark(self, command: messages.Command) -> None:
        if not 0 < command.mark.back_ms <= LONGEST_MARK_MS:
            raise RefusedError(
                f"back_ms is {command.mark.back_ms}, expected 1 to {LONGEST_MARK_MS}"
            )
        self._helm.mark(Mark(name_in_a_line(command.sender), command.mark.back_ms))

    def _drive(self, command: messages.Command) -> None:
        drive, now_ns = command.drive, time.monotonic_ns()
        press = Press(command.sender_id, drive.press, name_in_a_line(command.sender))
        if drive.let_go:
            self._helm.let_go(press)
            return
        if not 0 < drive.hold_ms <= LONGEST_HOLD_MS:
            raise RefusedError(f"hold_ms is {drive.hold_ms}, expected 1 to {LONGEST_HOLD_MS}")
        hold_ns = drive.hold_ms * 1_000_000
        good_ns = command.expires_monotonic_ns - now_ns
        if not drive.press or good_ns > hold_ns + CLOCK_SLACK_NS:
            # It could arrive when the hand has long let go, and set the robot in motion again.
            raise RefusedError(
                f"the command is good for {good_ns / 1e6:.0f} ms, holds for {drive.hold_ms} ms and "
                f"is of press {drive.press}: expected to be good for no longer than it holds, and "
                "a press from 1 on; upgrade the workstation"
            )
        try:
            steps = to_steps(drive.wheels.left, drive.wheels.right)
        except ValueError as error:
            raise RefusedError(str(error)) from None
        if (fault := self._board.fault) is not None:
            raise RefusedError(fault.detail)
        until_ns = min(now_ns + hold_ns, command.expires_monotonic_ns)
        duties = self._wheels.duties(steps)
        self._helm.steer_by_hand(duties, until_ns, command.stop_count, press)
