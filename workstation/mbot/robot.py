"""A robot, as a Python program has it: look, run, stop, drive, listen, push, record."""

import math
import os
from collections.abc import Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Self

from mbot.beat import Beat
from mbot.held_wheels import HeldWheels
from mbot.listening import beats, frames, recorded
from mbot.state import RobotState, look_again
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_workstation.fleet.enrolment.enrolled_robots import find_destination, find_destinations
from mbot_workstation.fleet.link.address import ADDRESS_VARIABLE, Destination
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.security import LinkSecurity
from mbot_workstation.fleet.models.key_choice import ChooseKey


class Robot:
    """One robot; use it in a `with`. Nothing but `run` and `drive` sets it in motion.

    Both need that the program has seen the robot's last stop: entering the block is a look, so is
    `state()`. Whoever stops it afterwards is not driven over (docs/arming.md).

    The end of the block lets go of wheels that `drive` turns. A policy that `run` has set off goes
    on, as after `workstation run`.

    All errors are `MbotError`s of one line that says what to do.
    """

    def __init__(
        self,
        name: str = "",
        *,
        robot_id: str | None = None,
        security: LinkSecurity | None = None,
        sign_with: str = "",
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            name: an enrolled robot, or HOST, HOST:PORT, tls/HOST:PORT; empty: $MBOT_ROBOT, or the
                only enrolled robot, or the one on this machine.
            robot_id: which robot, where several are alive behind one address.
            security: certificates for an address; an enrolled robot's are found.
            sign_with: the key that signs what is pushed; empty: the first that the robot trusts.

        Raises:
            ConfigurationError: no such robot, or an address or a file is unusable.

        """
        found = _destination(name or os.environ.get(ADDRESS_VARIABLE, ""), robot_id, security)
        self._link = RobotLink(str(found.endpoint), found.robot_id, found.security)
        self._wheels = HeldWheels(self._link)
        self._seen = Status()
        self._sign_with = sign_with
        self._choose_key: ChooseKey | None = None

    @classmethod
    @contextmanager
    def virtual(
        cls,
        task: str = "fetch",
        policy: Path | str | None = None,
        *,
        name: str = "virtual-mbot",
        seed: int = 0,
        options: Sequence[str] = (),
    ) -> Generator[Self]:
        """A virtual robot with a daemon of its own; both are gone when the block ends. Takes 5 s.

        Args:
            task: what there is to do in its arena, by the task's name or file.
            policy: an ONNX file that is pushed, or "servo", which needs no training; None: none,
                so that it can only be driven by hand.
            name: what it is called.
            seed: of the room and the objects.
            options: further ones of `workstation virtual-robot`, such as ("--arena", "home").

        Raises:
            MbotError: a file is unusable, or one of the two programs did not start.

        """
        from mbot.virtual import virtual_robot

        started = virtual_robot(name, task, policy, seed, options)
        with started as (both, model), cls(both.address) as robot:
            robot._choose_key = lambda _: both.key
            if model is not None:
                robot.push(model)
            yield robot

    def __enter__(self) -> Self:
        """Connect, and look at it; raises UnreachableError if nobody answers, or several do."""
        self._link.__enter__()
        self._wheels = HeldWheels(self._link)
        try:
            self._seen = self._link.status()
        except BaseException:
            self._link.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._wheels.close()
        finally:
            self._link.__exit__()

    @property
    def name(self) -> str:
        """What it is called."""
        return self._link.robot_id

    def state(self) -> RobotState:
        """How it is now. This is a look: whoever has stopped it, the program knows of it now."""
        self._seen = self._link.status()
        return RobotState.of(self._seen)

    def run(self, *, when_ready: bool = False) -> RobotState:
        """Let its policy drive, also after the block; `stop` ends it. Lets go of the wheels before.

        Args:
            when_ready: also if something is in the way now: begin as soon as it can, within 30 s.

        Returns:
            How it is then; with `when_ready` its state may be "fault": it waits.

        Raises:
            RefusedError: something is in the way, it was stopped since the last look, or you have
                not the right to drive it.
            UnreachableError: it doesn't answer.

        """
        self._wheels.let_go()
        control = RemoteControl(self._link)
        look_again(control, self._seen)
        control.run(when_ready=when_ready)
        status = control.after_run()
        if status.last_stop.count != self._seen.last_stop.count:
            look_again(control, self._seen)
        return RobotState.of(status)

    def stop(self) -> None:
        """Stop, whoever drives; returns once its board has confirmed that the motors are off.

        Raises an MbotError where that is not confirmed: it may be driving still.
        """
        self._wheels.forget()
        RemoteControl(self._link).stop()
        self.state()

    def drive(self, left: float, right: float, seconds: float | None = None) -> None:
        """Turn the wheels, also instead of a policy, which does not go on by itself afterwards.

        Until the next `drive`, `let_go`, `run`, `stop` or the end of the block; they stop within
        0.5 s if this process or the link dies.

        Args:
            left, right: wheels in [-1, 1], 1 is full speed forward.
            seconds: wait for so long, then let go; None: return at once.

        Raises:
            ConfigurationError: a number is out of range.
            RefusedError: it was stopped since the last look or during `seconds`, or says why not.
            UnreachableError: it doesn't answer.

        """
        if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
            raise ConfigurationError(f"seconds is {seconds}, expected a number above 0")
        self._wheels.hold(left, right, self._seen)
        if seconds is not None:
            try:
                self._wheels.wait(seconds)
            finally:
                self._wheels.let_go()

    def let_go(self) -> None:
        """Stop the wheels that `drive` turns. No stop in anybody's log; `drive` may follow."""
        self._wheels.let_go()

    def beats(self, seconds: float | None = None) -> Iterator[Beat]:
        """Its beats as they come, each once, whether or not it drives; for `seconds`, or on and on.

        Raises UnreachableError when nothing has come for 10 s.
        """
        return beats(self._link, seconds)

    def frames(self, seconds: float | None = None, *, wide: bool = False) -> Iterator[Picture]:
        """What it sees, as it comes, 2.5 times a second: the newest, so a slow reader misses some.

        Args:
            seconds: end after so long; None: go on.
            wide: what the camera sees, shape (height, 320, 3); else what the policy sees, shape
                (64, 64, 3). Both uint8, RGB.

        Raises:
            UnreachableError: nothing, or no picture, has come for 10 s.

        """
        return frames(self._link, seconds, wide=wide)

    def record(self, path: Path | str) -> AbstractContextManager[None]:
        """A block during which all that it tells goes into a new MCAP file, pictures included.

        Raises ConfigurationError if the file is there already, or can't be written.
        """
        return recorded(self._link, Path(path))

    def push(self, path: Path | str) -> RobotState:
        """Check a policy, sign and send it, and have it made active; a robot that drives goes on.

        One that waits to drive is disarmed. If this very model is active already nothing is sent.

        Raises:
            ConfigurationError, ContractError: the file is not fit to be sent.
            RefusedError: no key of ours would do, or the robot says why it keeps its own.
            UnreachableError: the link broke.

        """
        from mbot_workstation.fleet.models.push import push

        push(self._link, Path(path), self._choose_key or self._own_keys())
        return RobotState.of(self._link.status())

    def _own_keys(self) -> ChooseKey:
        from mbot_workstation.cli.models import ask_passphrase
        from mbot_workstation.fleet.models.key_choice import chooser
        from mbot_workstation.fleet.models.key_folder import KeyFolder

        return chooser(KeyFolder(), self._sign_with, ask_passphrase)


def _destination(name: str, robot_id: str | None, security: LinkSecurity | None) -> Destination:
    if not name and security is None:
        names = [one.robot_id for one in find_destinations([]) if one.robot_id is not None]
        if len(names) > 1 and robot_id is None:
            raise ConfigurationError(
                f"{len(names)} robots are enrolled here ({', '.join(names)})",
                remedy=f"name one, as in Robot({names[0]!r})",
            )
        name = robot_id or names[0] if names else ""
    return find_destination(name, robot_id, security)
