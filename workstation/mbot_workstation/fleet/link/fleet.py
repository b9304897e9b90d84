"""Who is alive at some addresses, and how each one is doing."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

from mbot_protocol.beat.fields import state_word
from mbot_protocol.errors import MbotError, UnreachableError
from mbot_protocol.v1.messages_pb2 import MotorMap, Status
from mbot_workstation.fleet.link.address import Destination, Endpoint
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.robot_session import alive_robots, open_session
from mbot_workstation.fleet.link.security import LinkSecurity


@dataclass(frozen=True, slots=True)
class RobotReport:
    """One robot, or an address where none was found.

    Attributes:
        address: where it was looked for.
        robot_id: empty if no robot is alive there.
        status: as the robot told it; None with an error.
        error: why there is no status; empty with one.

    """

    address: str
    robot_id: str
    status: Status | None
    error: str

    def fields(self) -> dict[str, object]:
        """The report as a flat JSON object; null where the robot said nothing."""
        status = self.status or Status()
        known = self.status is not None
        return {
            "address": self.address,
            "robot_id": self.robot_id or None,
            "state": state_word(status.state) if known else None,
            "hand_let_go": bool(status.let_go_monotonic_ns) if known else None,
            "faults": [{"kind": f.kind, "detail": f.detail} for f in status.faults],
            "notices": [{"kind": n.kind, "detail": n.detail} for n in status.notices],
            "accepts_unsigned_models": status.accepts_unsigned_models if known else None,
            "trusted_keys": list(status.trusted_keys),
            "model_sha256": status.active_model.sha256 or None,
            "model_name": status.active_model.name or None,
            "model_signed_by": status.active_model.signed_by or None,
            "decision_rate_hz": round(status.decision_rate_hz, 3) if known else None,
            "decisions": status.decisions if known else None,
            "missed_ticks": status.missed_ticks if known else None,
            "board_version": status.board_version or None,
            "board_has_deadman": status.board_has_deadman if known else None,
            "left_motor": _motor_fields(status.left_motor),
            "right_motor": _motor_fields(status.right_motor),
            "camera": status.camera or None,
            "software_version": status.software_version or None,
            "release": status.release or None,
            "error": self.error or None,
        }


def _motor_fields(motor: MotorMap) -> dict[str, object] | None:
    """As the robot drives it now; None where it does not say, as before that was asked of it."""
    if not motor.trim:
        return None
    trim = round(motor.trim, 6)
    return {"reversed": motor.reversed, "trim": trim, "dead_band": motor.dead_band}


def look_around(destinations: Sequence[Destination]) -> list[RobotReport]:
    """Reports from all destinations at once, in their order."""
    with ThreadPoolExecutor(max_workers=min(16, max(1, len(destinations)))) as pool:
        found = pool.map(_look_at, destinations)
        return [report for reports in found for report in reports]


def each_robot(
    destinations: Sequence[Destination],
) -> tuple[list[Destination], list[UnreachableError]]:
    """One destination a robot: who is alive where no robot was named, each robot once.

    Also why nobody is found at those addresses where nobody is.
    """
    unreachable: list[UnreachableError] = []
    found: dict[str, Destination] = {}
    for one in destinations:
        try:
            ids = [one.robot_id] if one.robot_id is not None else _alive(one)
        except UnreachableError as error:
            unreachable.append(error)
            continue
        for robot_id in ids:
            found.setdefault(robot_id, replace(one, robot_id=robot_id))
    return list(found.values()), unreachable


def _alive(destination: Destination) -> list[str]:
    with open_session(destination.endpoint, destination.security) as session:
        if robots := alive_robots(session):
            return robots
    raise UnreachableError(f"no robot is alive at {destination.endpoint}")


def _look_at(destination: Destination) -> list[RobotReport]:
    endpoint, security = destination.endpoint, destination.security
    if destination.robot_id is not None:
        return [_ask(endpoint, destination.robot_id, security)]
    try:
        robots = _alive(destination)
    except MbotError as error:
        return [RobotReport(str(endpoint), "", None, str(error))]
    return [_ask(endpoint, robot_id, security) for robot_id in robots]


def _ask(endpoint: Endpoint, robot_id: str, security: LinkSecurity | None) -> RobotReport:
    try:
        with RobotLink(str(endpoint), robot_id, security) as link:
            return RobotReport(str(endpoint), robot_id, link.status(), "")
    except MbotError as error:
        return RobotReport(str(endpoint), robot_id, None, str(error))
