"""What is wrong, and what is worth knowing."""

from dataclasses import dataclass

from mbot_protocol.drive.senses import Senses


@dataclass(frozen=True, slots=True)
class Fault:
    """A reason why the robot may not drive now.

    One word for machines, one line for people: what was found and what to do.
    """

    kind: str
    detail: str


@dataclass(frozen=True, slots=True)
class Notice:
    """Something to know that does not keep the robot from driving; in the form of a fault."""

    kind: str
    detail: str


def fault_ahead(senses: Senses | None) -> Fault | None:
    """Why a policy must not drive now: no floor in front of the robot, or something in its way."""
    if senses is None:
        return None
    if senses.over_an_edge:
        return Fault(
            "edge",
            "no floor in front of the robot, or a dark one: lift it back or drive it back by hand",
        )
    if senses.at_obstacle:
        return Fault("obstacle", f"something is {senses.distance_m * 100:.0f} cm ahead")
    return None
