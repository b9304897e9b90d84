"""What is wanted of the robot: who may set it in motion, what disarms it, and what that takes back.

Pure values and transitions; `Helm` keeps the one that holds, under its lock. The rule of
docs/arming.md: nothing but an explicit `run` or `drive` that names the last stop sets a disarmed
robot in motion. A stop by anybody, and everything the robot must not forgive by itself, counts up.
"""

from dataclasses import dataclass, replace
from enum import Enum

from mbot_agent.faults import Fault
from mbot_protocol.errors import RefusedError


class Mode(Enum):
    """What a person, or the configuration, wants."""

    IDLE = "idle"
    WAITING = "waiting"
    """Told to drive as soon as nothing is in the way any more."""
    RUNNING = "running"
    STOPPED = "stopped"
    MANUAL = "manual"


class State(Enum):
    """What the robot does: its mode, or `fault` where it should drive and cannot."""

    IDLE = "idle"
    RUNNING = "running"
    STOPPED = "stopped"
    MANUAL = "manual"
    FAULT = "fault"


_ARMED = (Mode.WAITING, Mode.RUNNING, Mode.MANUAL)


def state_of(mode: Mode, faults: tuple[Fault, ...]) -> State:
    """The state that follows from what is wanted and what is wrong."""
    if mode is Mode.WAITING or (faults and mode in _ARMED):
        return State.FAULT
    return State(mode.value)


@dataclass(frozen=True, slots=True)
class Driver:
    """Who drives by hand, as they call themselves, and since when (monotonic)."""

    name: str
    since_ns: int


@dataclass(frozen=True, slots=True)
class Mark:
    """What the robot did in the last `back_ms` was wrong, somebody says."""

    by: str
    back_ms: int


@dataclass(frozen=True, slots=True)
class Stop:
    """The last thing that disarmed the robot.

    Attributes:
        count: how many there have been in this session; the start counts as the first.
        by: who, as they call themselves; empty: the robot itself.
        why: what the robot found; empty: a person said so.
        at_ns: monotonic; 0 for the start.

    """

    count: int = 1
    by: str = ""
    why: str = ""
    at_ns: int = 0

    def in_words(self, now_ns: int) -> str:
        """Who or what it was, and how long ago."""
        ago_s = (now_ns - self.at_ns) / 1e9
        if self.why:
            return f"stopped {ago_s:.1f} s ago ({self.why})"
        return f"stopped by {self.by or 'somebody'} {ago_s:.1f} s ago"


@dataclass(frozen=True, slots=True)
class Orders:
    """What holds now.

    Attributes:
        mode: what is wanted.
        epoch: changes before this one: a decision begun under another epoch is outdated.
        stop: the last stop.
        let_go_ns: when the hand let go (monotonic), while that is why the robot stands; else 0.
        given_ns: when a person last wanted it to move (monotonic); 0 before the first time.

    """

    mode: Mode
    epoch: int = 0
    stop: Stop = Stop()
    let_go_ns: int = 0
    given_ns: int = 0

    @property
    def is_armed(self) -> bool:
        """Whether the wheels may turn without anybody saying more."""
        return self.mode in _ARMED

    def armed(self, mode: Mode, seen_stops: int, now_ns: int) -> "Orders":
        """A person, who knows of so many stops, wants the robot to move.

        Raises:
            RefusedError: there has been another stop since.

        """
        if seen_stops != self.stop.count:
            if not seen_stops:
                raise RefusedError("the command names no stop count: upgrade the workstation")
            raise RefusedError(f"{self.stop.in_words(now_ns)}; look, then run again")
        return replace(self._to(mode), given_ns=now_ns)

    def ready(self) -> "Orders":
        """Nothing is in the way any more of a robot that was told to wait for that."""
        return self._to(Mode.RUNNING) if self.mode is Mode.WAITING else self

    def released(self, now_ns: int) -> "Orders":
        """The hand has let go: a new `drive` may follow, nothing else moves."""
        if self.mode is not Mode.MANUAL:
            return self
        return replace(self._to(Mode.STOPPED), let_go_ns=now_ns)

    def stopped(self, now_ns: int, *, by: str = "", why: str = "") -> "Orders":
        """Disarmed, by a person or for a reason; what was sent before is refused from now on."""
        stop = Stop(self.stop.count + 1, by, why, now_ns)
        return replace(self._to(Mode.STOPPED), stop=stop)

    def _to(self, mode: Mode) -> "Orders":
        return replace(self, mode=mode, epoch=self.epoch + 1, let_go_ns=0)


class Hold:
    """How long something has been in the way of a robot that runs: a short gap is forgiven."""

    def __init__(self, longest_s: float) -> None:
        self._longest_ns = round(longest_s * 1e9)
        self._since_ns: int | None = None

    def too_long(self, faults: tuple[Fault, ...], now_ns: int) -> Fault | None:
        """The fault that is in the way for longer than forgiven, if any; ask at every tick."""
        if not faults:
            self._since_ns = None
            return None
        if self._since_ns is None:
            self._since_ns = now_ns
        return faults[0] if now_ns - self._since_ns > self._longest_ns else None
