"""Who is alive at some addresses, and how each one is doing."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace

import msgspec

from mbot_protocol.beat.fields import state_word
from mbot_protocol.errors import MbotError, UnreachableError
from mbot_protocol.v1.messages_pb2 import MotorMap, Status
from mbot_workstation.fleet.link.address import Destination, Endpoint
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.robot_session import alive_robots, open_session
from mbot_workstation.fleet.link.security import LinkSecurity


class Found(msgspec.Struct, frozen=True):
    """A fault, or a notice, as the robot tells it."""

    kind: str
    detail: str


class Motor(msgspec.Struct, frozen=True):
    """How a motor is driven now."""

    reversed: bool
    trim: float
    dead_band: int


class RobotReport(msgspec.Struct, frozen=True, kw_only=True):
    """One robot, or an address where none was found; None where the robot said nothing.

    Attributes:
        address: where it was looked for.
        robot_id: None if no robot is alive there.
        error: why nothing is known of it; None if it told its status.

    """

    address: str
    robot_id: str | None = None
    state: str | None = None
    hand_let_go: bool | None = None
    faults: list[Found] = []
    notices: list[Found] = []
    accepts_unsigned_models: bool | None = None
    trusted_keys: list[str] = []
    model_sha256: str | None = None
    model_name: str | None = None
    model_signed_by: str | None = None
    decision_rate_hz: float | None = None
    decisions: int | None = None
    missed_ticks: int | None = None
    board_version: str | None = None
    board_has_deadman: bool | None = None
    left_motor: Motor | None = None
    right_motor: Motor | None = None
    camera: str | None = None
    software_version: str | None = None
    release: str | None = None
    error: str | None = None

    @classmethod
    def of(cls, address: str, robot_id: str, status: Status) -> "RobotReport":
        """What a robot told."""
        return cls(
            address=address,
            robot_id=robot_id,
            state=state_word(status.state),
            hand_let_go=bool(status.let_go_monotonic_ns),
            faults=[Found(one.kind, one.detail) for one in status.faults],
            notices=[Found(one.kind, one.detail) for one in status.notices],
            accepts_unsigned_models=status.accepts_unsigned_models,
            trusted_keys=list(status.trusted_keys),
            model_sha256=status.active_model.sha256 or None,
            model_name=status.active_model.name or None,
            model_signed_by=status.active_model.signed_by or None,
            decision_rate_hz=round(status.decision_rate_hz, 3),
            decisions=status.decisions,
            missed_ticks=status.missed_ticks,
            board_version=status.board_version or None,
            board_has_deadman=status.board_has_deadman,
            left_motor=_motor(status.left_motor),
            right_motor=_motor(status.right_motor),
            camera=status.camera or None,
            software_version=status.software_version or None,
            release=status.release or None,
        )


def _motor(motor: MotorMap) -> Motor | None:
    """None where the robot does not say, as before that was asked of it."""
    if not motor.trim:
        return None
    return Motor(motor.reversed, round(motor.trim, 6), motor.dead_band)


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


def open_links(
    destinations: Sequence[Destination], stack: ExitStack
) -> tuple[list[RobotLink], list[UnreachableError]]:
    """A link to each robot that answers, closed with the stack, and why others do not.

    Raises:
        UnreachableError: none does.

    """
    robots, problems = each_robot(destinations)
    links: list[RobotLink] = []
    for one in robots:
        link = RobotLink(str(one.endpoint), one.robot_id, one.security)
        try:
            stack.enter_context(link).status()
            links.append(link)
        except UnreachableError as error:
            problems.append(error)
    if not links:
        raise problems[0]
    return links, problems


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
        return [RobotReport(address=str(endpoint), error=str(error))]
    return [_ask(endpoint, robot_id, security) for robot_id in robots]


def _ask(endpoint: Endpoint, robot_id: str, security: LinkSecurity | None) -> RobotReport:
    try:
        with RobotLink(str(endpoint), robot_id, security) as link:
            return RobotReport.of(str(endpoint), robot_id, link.status())
    except MbotError as error:
        return RobotReport(address=str(endpoint), robot_id=robot_id, error=str(error))
