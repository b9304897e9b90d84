"""What is wanted of the robot, and the state that follows from it and from what is wrong."""

from dataclasses import dataclass
from enum import Enum

from mbot_agent.faults import Fault


class Mode(Enum):
    """What a person, or the configuration, wants."""

    IDLE = "idle"
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


def state_of(mode: Mode, faults: tuple[Fault, ...]) -> State:
    """The state that follows from what is wanted and what is wrong."""
    if faults and mode in (Mode.RUNNING, Mode.MANUAL):
        return State.FAULT
    return State(mode.value)


@dataclass(frozen=True, slots=True)
class Orders:
    """A mode and the number of changes before it: orders with another number are outdated."""

    mode: Mode
    epoch: int
