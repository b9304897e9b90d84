"""A fleet enrolled as a person would, and robots that are nothing but the daemon's own link."""

import tomllib
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from mbot_agent.configuration import Access, Configuration, Network
from mbot_agent.network.zenoh_link import Link
from mbot_protocol.wire.access_rules import Kind
from mbot_protocol.wire.keys import DECISION, TOPICS, Flow, Right
from mbot_workstation.fleet.enrolment.bundles import enrolment_toml, zenohd_json5
from mbot_workstation.fleet.enrolment.certificates import issue
from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder
from mbot_workstation.fleet.enrolment.membership import Enrolment
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.security import LinkSecurity

from ..free_port import free_port

LOCALHOST = "127.0.0.1"


class Fleet:
    """A folder with an authority, and what was enrolled in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = FleetFolder(folder)
        self.enrolment = Enrolment(self.folder)
        self.ports: dict[str, int] = {}

    def enrol(
        self,
        robot_id: str,
        people: Mapping[str, Collection[Right]] | None = None,
        router: str | None = None,
        host: str = LOCALHOST,
    ) -> None:
        port = self.ports.setdefault(robot_id, free_port())
        self.enrolment.robot(robot_id, [host], port, people, router)

    def configuration(self, robot_id: str) -> Configuration:
        """The robot's, from what the workstation would have it copy."""
        document = tomllib.loads(self.enrolment_text(robot_id))
        return Configuration(
            robot_id=document["robot_id"],
            network=msgspec.convert(document["network"], Network),
            access=msgspec.convert(document["access"], Access),
        )

    def enrolment_text(self, robot_id: str) -> str:
        """The robot's enrolment.toml, with certificates that are really there."""
        files = self.unpacked(Kind.ROBOT, robot_id)
        return enrolment_toml(self.folder.roll(), robot_id, str(files))

    def router_settings(self, name: str) -> str:
        """The router's zenohd.json5."""
        return zenohd_json5(self.folder.roll(), name, str(self.unpacked(Kind.ROUTER, name)))

    def unpacked(self, kind: Kind, name: str) -> Path:
        """Certificates as they lie on a robot or router."""
        target = self.folder.path / "unpacked" / name
        target.mkdir(parents=True, exist_ok=True)
        identity = self.folder.identity(kind, name)
        (target / "ca.pem").write_bytes(self.folder.authority_pem)
        (target / f"{kind.value}.pem").write_bytes(identity.certificate_pem)
        (target / f"{kind.value}.key").write_bytes(identity.key_pem)
        return target

    def security(self, person: str) -> LinkSecurity:
        return self.folder.security(person)

    def security_of_robot(self, robot_id: str) -> LinkSecurity:
        """A robot's certificate in the hands of somebody who has taken its card."""
        files = self.unpacked(Kind.ROBOT, robot_id)
        return LinkSecurity(files / "ca.pem", files / "robot.pem", files / "robot.key")

    def expired(self, person: str) -> LinkSecurity:
        """A certificate of this person whose time was up yesterday."""
        return self.ending(person, -24 * 3600)

    def ending(self, person: str, in_s: float) -> LinkSecurity:
        """A certificate of this person that ends so soon."""
        identity = issue(self.folder.authority, Kind.PERSON, person, days=in_s / 24 / 3600)
        target = self.folder.path / "ending"
        target.mkdir(exist_ok=True)
        certificate, key = target / f"{person}.pem", target / f"{person}.key"
        certificate.write_bytes(identity.certificate_pem)
        key.write_bytes(identity.key_pem)
        return LinkSecurity(self.folder.path / "authority.pem", certificate, key)

    def link(self, robot_id: str, person: str) -> RobotLink:
        endpoint = self.folder.roll().endpoint(robot_id)
        return RobotLink(str(endpoint), robot_id, self.security(person))


class TalkingRobot:
    """The daemon's link with an answer to every query: which robot, and which key was asked."""

    def __init__(self, configuration: Configuration) -> None:
        self.robot_id = configuration.robot_id
        self.link = Link(configuration)
        self.asked: list[str] = []

    def __enter__(self) -> Self:
        self.link.__enter__()
        for topic in TOPICS:
            if topic.flow is Flow.QUERY:
                self.link.serve({topic.name: self._answer(topic.name)})
        self.link.announce()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with suppress(Exception):
            self.link.__exit__(kind, error, trace)

    def _answer(self, name: str):
        def answer(_: bytes) -> bytes:
            self.asked.append(name)
            return f"{self.robot_id} {name}".encode()

        return answer

    def say(self) -> None:
        """Publish a record of telemetry."""
        self.link.publish(DECISION, f"{self.robot_id} decides".encode())
