"""Drive one maneuver, and know what the robot was told when, on its own clock."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbot_protocol.errors import MbotError, RefusedError, UnreachableError
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.measure.tracks.maneuver import Maneuver
from mbot_workstation.measure.tracks.run import CommandSeries

SAMPLES = 8
"""The fastest of so many replies counts: a Wi-Fi reply mostly takes 2 ms and sometimes 50."""


@dataclass(frozen=True, slots=True)
class RobotTime:
    """How the clocks lie to each other. They drift by up to 0.1 ms a second, so ask often.

    Attributes:
        ahead_ns: the robot's monotonic clock minus this machine's.
        uncertainty_ns: the true value is within this to either side.

    """

    ahead_ns: int
    uncertainty_ns: int

    def robot_s(self, here_ns: int) -> float:
        """The robot's clock at a moment of this machine's monotonic clock."""
        return (here_ns + self.ahead_ns) / 1e9


def measure_robot_time(
    link: RobotLink, samples: int = SAMPLES, monotonic_ns: Callable[[], int] = time.monotonic_ns
) -> RobotTime:
    """Ask the robot for its time; the reply was written somewhere between asking and receiving.

    Raises:
        UnreachableError, RefusedError, ...: as `RobotLink.query`.

    """
    measured: list[RobotTime] = []
    for _ in range(samples):
        asked_ns = monotonic_ns()
        robot_ns = link.status().now_monotonic_ns
        heard_ns = monotonic_ns()
        half_ns = (heard_ns - asked_ns) // 2
        measured.append(RobotTime(robot_ns - asked_ns - half_ns, half_ns))
    return min(measured, key=lambda one: one.uncertainty_ns)


RESEND_NS = 100_000_000
HOLD_MS = 500
"""Four commands in a row may be lost before the robot stops between them; then the run is spoilt
and the robot has stopped by itself."""

STANDING_S = 1.0
"""The first row, of standing still, is so long before the first command."""


class SpoiltRunError(MbotError):
    """The robot was not told without a gap what it should have been told."""


@dataclass(frozen=True, slots=True, eq=False)
class DrivenCommands:
    """What was sent.

    Attributes:
        series: on the robot's clock.
        uncertainty_s: of its times.

    """

    series: CommandSeries
    uncertainty_s: float


@dataclass(frozen=True, slots=True)
class _Sent:
    """One command that the robot has accepted between these moments of our clock."""

    before_ns: int
    after_ns: int
    hold_ms: int
    told: tuple[float, float]

    @property
    def middle_ns(self) -> int:
        return (self.before_ns + self.after_ns) // 2

    def holds_until(self, at_ns: int) -> bool:
        """To a millisecond, which is as fine as `hold_ms` is."""
        return self.middle_ns + self.hold_ms * 1_000_000 >= at_ns - 1_000_000


def drive_maneuver(
    control: RemoteControl,
    robot_time: RobotTime,
    maneuver: Maneuver,
    seconds: float,
    interrupted: Callable[[], bool] = lambda: False,
) -> DrivenCommands:
    """Drive a maneuver for so long, then stop; the robot stands when this returns or raises.

    Args:
        control: synchronised.
        robot_time: measured just before.
        maneuver: what to tell the robot.
        seconds: how long.
        interrupted: looked at ten times a second; True stops at once.

    Raises:
        SpoiltRunError: interrupted, the link was lost or too slow, or the robot refused; it stands.
        UnreachableError: STOP was not confirmed; the robot stops by itself within 0.5 s.

    """
    sent: list[_Sent] = []
    try:
        until_ns = time.monotonic_ns() + round(seconds * 1e9)
        while (left_ms := (until_ns - time.monotonic_ns()) // 1_000_000) > 0:
            if interrupted():
                raise SpoiltRunError("stopped by hand")
            begun_ns = sent[0].middle_ns if sent else time.monotonic_ns()
            told = maneuver.told((time.monotonic_ns() - begun_ns) / 1e9)
            # One that holds until the end is the last one, unless another is told.
            if not sent or sent[-1].told != told or not sent[-1].holds_until(until_ns):
                sent.append(_send(control, told, min(HOLD_MS, left_ms)))
                if len(sent) == 1:
                    until_ns = sent[0].middle_ns + round(seconds * 1e9)
                else:
                    _check_gap(sent[-2], sent[-1])
            beats = (time.monotonic_ns() - sent[0].middle_ns) // RESEND_NS + 1
            _sleep_until(min(sent[0].middle_ns + beats * RESEND_NS, until_ns))
    finally:
        stop_before_ns = time.monotonic_ns()
        control.stop()
        stop_after_ns = time.monotonic_ns()
    # Whichever came first has stopped it: the last command's expiry, or STOP.
    expired_ns = sent[-1].middle_ns + sent[-1].hold_ms * 1_000_000
    stopped_ns = min(expired_ns, (stop_before_ns + stop_after_ns) // 2)
    series = _series(sent, stopped_ns, robot_time)
    travel_ns = max(sent[0].after_ns - sent[0].before_ns, sent[-1].after_ns - sent[-1].before_ns)
    return DrivenCommands(series, (robot_time.uncertainty_ns + travel_ns / 2) / 1e9)


def _series(sent: Sequence[_Sent], stopped_ns: int, robot_time: RobotTime) -> CommandSeries:
    """A row at every change of what was told, from standing to standing."""
    changes = [
        one
        for one, before in zip(sent, (None, *sent), strict=False)
        if before is None or one.told != before.told
    ]
    begun_s = robot_time.robot_s(changes[0].middle_ns)
    return CommandSeries(
        np.array(
            [
                begun_s - STANDING_S,
                *(robot_time.robot_s(one.middle_ns) for one in changes),
                robot_time.robot_s(stopped_ns),
            ]
        ),
        np.array([0.0, *(one.told[0] for one in changes), 0.0]),
        np.array([0.0, *(one.told[1] for one in changes), 0.0]),
    )


def _send(control: RemoteControl, told: tuple[float, float], hold_ms: int) -> _Sent:
    before_ns = time.monotonic_ns()
    try:
        control.drive(*told, hold_ms)
    except (UnreachableError, RefusedError) as error:
        raise SpoiltRunError(str(error)) from None
    return _Sent(before_ns, time.monotonic_ns(), hold_ms, told)


def _check_gap(first: _Sent, second: _Sent) -> None:
    """Whether the first command may have expired before the second came, at worst."""
    gap_ms = (second.after_ns - first.before_ns) / 1e6
    if gap_ms > first.hold_ms:
        raise SpoiltRunError(
            f"the link was too slow: {gap_ms:.0f} ms between two commands, and the robot stops "
            f"{first.hold_ms} ms after one"
        )


def _sleep_until(at_ns: int) -> None:
    time.sleep(max(0.0, (at_ns - time.monotonic_ns()) / 1e9))
