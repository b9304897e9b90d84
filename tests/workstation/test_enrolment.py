import io
import os
import stat
import tarfile
import tomllib
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest
from cryptography import x509
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.configuration import Configuration, decode
from mbot_agent.configuration_files import ENROLMENT_FILE, enrolled, trusting
from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_protocol.wire.access_rules import Kind
from mbot_protocol.wire.keys import Right
from mbot_workstation.fleet.enrolment import membership as enroll
from mbot_workstation.fleet.enrolment.bundles import read_person_bundle
from mbot_workstation.fleet.enrolment.certificates import (
    BACKDATED,
    hosts_in,
    issue,
    make_authority,
)
from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder
from mbot_workstation.fleet.enrolment.hand_over_words import instructions
from mbot_workstation.fleet.enrolment.membership import Enrolment, HandOver
from mbot_workstation.fleet.enrolment.roll import ROLL_FILE, decode_roll, encode_roll
from mbot_workstation.fleet.link.security import owner_name
from mbot_workstation.fleet.models.key_choice import chooser
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.models.signing_key import SigningKey

NOW = datetime(2030, 5, 17, 12, tzinfo=UTC)


class Clock:
    """Stands still until told."""

    def __init__(self) -> None:
        self.now = NOW

    def __call__(self) -> datetime:
        return self.now


@pytest.fixture(autouse=True)
def rosa(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(enroll.getpass, "getuser", lambda: "Rosa")


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def enrolment(tmp_path: Path, clock: Clock) -> Enrolment:
    return Enrolment(FleetFolder(tmp_path / "fleet"), clock)


def names(hand_overs: list[HandOver]) -> list[str]:
    return [f"{h.kind.value} {h.name}" for h in hand_overs]


def unpack(path: Path, target: Path) -> Path:
    with tarfile.open(path) as tar:
        tar.extractall(target, filter="data")
    return target


def test_the_first_robot_begins_the_fleet_with_whoever_enrols_it(enrolment: Enrolment) -> None:
    assert names(enrolment.robot("mbot-1")) == ["robot mbot-1"]
    roll = enrolment.folder.roll()
    assert roll.me == "rosa"
    assert roll.robots["mbot-1"].people == {"rosa": (Right.PUSH, Right.DRIVE)}
    assert str(roll.endpoint("mbot-1")) == "tls/mbot-1.local:7447"


def test_secrets_are_the_owners_alone(enrolment: Enrolment) -> None:
    old = os.umask(0)
    try:
        enrolment.robot("mbot-1", people={"max": [Right.VIEW]})
    finally:
        os.umask(old)
    files = [p for p in enrolment.folder.path.rglob("*") if p.is_file()]
    assert {stat.S_IMODE(p.stat().st_mode) for p in files} == {0o600}
    assert stat.S_IMODE(enrolment.folder.path.stat().st_mode) == 0o700


def test_each_file_is_told_its_way(enrolment: Enrolment) -> None:
    [router] = enrolment.router("lab", hosts=["fd00::7"])
    _, person = enrolment.robot("mbot-1", people={"max": [Right.VIEW]})[-2:]
    roll = enrolment.folder.roll()
    _, copy, unpack_it = instructions(router, roll)
    assert copy.endswith("USER@[fd00::7]:")
    assert unpack_it.endswith("&& sudo systemctl restart zenohd'")
    assert instructions(person, roll)[-1] == "  there: workstation enroll --join max.tar"


def test_what_the_robot_gets_is_what_its_daemon_takes(enrolment: Enrolment, tmp_path: Path) -> None:
    enrolment.router("lab")
    [_, robot, max_] = enrolment.robot(
        "mbot-1", port=7450, people={"max": [Right.VIEW]}, router="lab"
    )
    assert (robot.host, max_.host) == ("mbot-1.local", None)
    root = unpack(robot.path, tmp_path / "root")
    with tarfile.open(robot.path) as tar:
        modes = {m.name: (m.mode, m.uname, m.gname) for m in tar}
    assert modes["etc/mbot-agent/tls/robot.key"] == (0o640, "root", "mbot-agent")
    folder = root / "etc" / "mbot-agent"
    found = enrolled(Configuration(robot_id="mbot-1"), folder / "config.toml")
    assert found.network.listen == ("tls/0.0.0.0:7450",)
    assert found.network.connect == ("tls/lab.local:7447",)
    assert found.access.routers == ("lab",)
    assert found.access.people == {"rosa": (Right.PUSH, Right.DRIVE), "max": (Right.VIEW,)}
    assert found.network.tls is not None
    assert found.network.tls.key == "/etc/mbot-agent/tls/robot.key"
    assert (folder / ENROLMENT_FILE).read_text().startswith("#")


def test_keys_go_along_until_others_do(enrolment: Enrolment, tmp_path: Path) -> None:
    def sent(*keys: str) -> tuple[str, ...]:
        robot, *_ = enrolment.robot("mbot-1", people={"max": [Right.VIEW]}, keys=keys)
        folder = unpack(robot.path, tmp_path / "root") / "etc" / "mbot-agent"
        found = trusting(Configuration(robot_id="mbot-1"), folder / "config.toml").trust
        assert (found.release_keys, found.allow_unsigned) == ((), False)
        return found.keys

    rosa, lab = (SigningKey.ephemeral(name).public.line for name in ("rosa", "lab"))
    assert sent() == ()
    old = (tmp_path / "root" / "etc" / "mbot-agent" / ENROLMENT_FILE).read_bytes()
    assert sent(rosa, lab) == (rosa, lab)
    assert sent() == (rosa, lab), "none given: as before"
    assert enrolment.renew() == []
    # A daemon from before reads what it always read, and a colleague is told nothing new.
    assert (tmp_path / "root" / "etc" / "mbot-agent" / ENROLMENT_FILE).read_bytes() == old
    joined = read_person_bundle(enrolment.folder.bundle_path(Kind.PERSON, "max").read_bytes(), "x")
    assert b"ed25519" not in encode_roll(joined[0])
    assert b'"keys"' not in encode_roll(joined[0])
    assert sent(lab) == (lab,)
    assert enrolment.keys_of("mbot-1") == (lab,)
    assert enrolment.keys_of("mbot-2") == ()


def test_who_may_push_gets_a_key_that_the_robot_takes(enrolment: Enrolment, tmp_path: Path) -> None:
    def trusted(robot_id: str) -> list[str]:
        path = enrolment.folder.bundle_path(Kind.ROBOT, robot_id)
        folder = unpack(path, tmp_path / robot_id) / "etc" / "mbot-agent"
        found = trusting(Configuration(robot_id=robot_id), folder / "config.toml").trust.keys
        return [line.partition(" ")[2] for line in found]

    def join(person: str) -> KeyFolder:
        keys = KeyFolder(tmp_path / person / "keys")
        theirs = Enrolment(FleetFolder(tmp_path / person / "fleet"), own_keys=keys)
        theirs.join(enrolment.folder.bundle_path(Kind.PERSON, person))
        return keys

    enrolment.robot("mbot-1", people={"max": [Right.PUSH], "eva": [Right.DRIVE, Right.VIEW]})
    enrolment.robot("mbot-2", people={"max": [Right.DRIVE]})
    assert trusted("mbot-1") == ["max"]
    assert trusted("mbot-2") == []
    assert join("eva").public_keys() == [], "who may not push signs nothing"
    keys = join("max")
    [line] = enrolment.keys_of("mbot-1")
    assert keys.load("max", lambda _: "").public.line == line
    status = Status(robot_id="mbot-1", trusted_keys=[line])
    assert chooser(keys, "", lambda _: "")(status) is not None
    assert stat.S_IMODE((keys.path / "max.pem").stat().st_mode) == 0o600
    assert [key.line for key in join("max").public_keys()] == [line], (
        "joining again changes nothing"
    )
    assert enrolment.renew() == []
    # The same key at another robot, and none at the first once the right is gone there.
    enrolment.robot("mbot-2", people={"max": [Right.PUSH]})
    enrolment.robot("mbot-1", people={"max": [Right.VIEW]})
    assert (trusted("mbot-1"), trusted("mbot-2")) == ([], ["max"])
    assert names(enrolment.revoke("max")) == ["robot mbot-1", "robot mbot-2"]
    assert trusted("mbot-2") == [], "the robot's file says so, or an older one would stay there"
    assert not list(enrolment.folder.path.rglob("max.*"))


def test_a_key_that_came_along_never_takes_anothers_place(tmp_path: Path) -> None:
    folder, made = KeyFolder(tmp_path / "own"), KeyFolder(tmp_path / "made")
    own, given = folder.new("max"), made.new("max")
    taken = folder.take("max", made.pem("max"))
    assert (taken.name, taken.raw) == ("max@fleet", given.raw)
    assert [key.raw for key in folder.public_keys()] == [own.raw, given.raw]
    for bad in (b"", b"rubbish"):
        assert "it is damaged" in refused(lambda bad=bad: folder.take("eva", bad))
    made.new("other")
    assert "other keys max and max@fleet" in refused(lambda: folder.take("max", made.pem("other")))


def test_its_text_also_fits_into_a_configuration(enrolment: Enrolment, tmp_path: Path) -> None:
    [robot] = enrolment.robot("mbot-1")
    text = (unpack(robot.path, tmp_path) / "etc" / "mbot-agent" / ENROLMENT_FILE).read_text()
    assert decode(text, "config.toml").network.tls is not None
    assert tomllib.loads(text)["robot_id"] == "mbot-1"


def test_a_certificate_is_kept_until_it_must_change(enrolment: Enrolment, clock: Clock) -> None:
    def serial() -> int:
        return enrolment.folder.identity(Kind.ROBOT, "mbot-1").certificate.serial_number

    enrolment.robot("mbot-1", ["mbot-1.local"])
    first = serial()
    enrolment.robot("mbot-1", people={"max": [Right.VIEW]})
    assert serial() == first
    enrolment.robot("mbot-1", ["mbot-1.local", "10.0.0.7"])
    second = serial()
    assert second != first
    clock.now += timedelta(days=300)
    enrolment.robot("mbot-1")
    assert serial() == second
    clock.now += timedelta(days=10)
    assert enrolment.renew()
    assert serial() != second


def test_names_of_hosts_are_in_the_certificate(enrolment: Enrolment) -> None:
    hosts = ["mbot-1.local", "10.0.0.7", "fd00::7"]
    enrolment.robot("mbot-1", hosts)
    certificate = enrolment.folder.identity(Kind.ROBOT, "mbot-1").certificate
    assert hosts_in(certificate) == set(hosts)
    assert owner_name(enrolment.folder.identity(Kind.ROBOT, "mbot-1").certificate_pem) == (
        "robot:mbot-1"
    )


def test_only_what_has_changed_must_be_handed_over(enrolment: Enrolment) -> None:
    enrolment.router("lab")
    enrolment.robot("mbot-1", people={"max": [Right.VIEW]})
    assert names(enrolment.robot("mbot-2")) == ["robot mbot-2"]
    assert names(enrolment.robot("mbot-1", router="lab")) == [
        "router lab",
        "robot mbot-1",
        "person max",
    ]
    assert names(enrolment.router("lab", ["10.0.0.1"])) == [
        "router lab",
        "robot mbot-1",
        "person max",
    ]
    assert enrolment.renew() == []


def test_rights_are_replaced_for_that_robot_only(enrolment: Enrolment) -> None:
    enrolment.robot("mbot-1", people={"max": [Right.DRIVE, Right.PUSH]})
    enrolment.robot("mbot-2", people={"max": [Right.DRIVE]})
    enrolment.robot("mbot-1", people={"max": [Right.VIEW]})
    robots = enrolment.folder.roll().robots
    assert robots["mbot-1"].people["max"] == (Right.VIEW,)
    assert robots["mbot-2"].people["max"] == (Right.DRIVE,)


def test_whoever_is_revoked_is_gone_for_good(enrolment: Enrolment) -> None:
    enrolment.robot("mbot-1", people={"max": [Right.VIEW]})
    enrolment.robot("mbot-2")
    assert names(enrolment.revoke("max")) == ["robot mbot-1"]
    roll = enrolment.folder.roll()
    assert "max" not in roll.people
    assert "max" not in roll.robots["mbot-1"].people
    assert not list(enrolment.folder.path.rglob("max.*"))
    with pytest.raises(RefusedError, match="'max' was revoked and cannot come back"):
        enrolment.robot("mbot-2", people={"max": [Right.VIEW]})


def test_a_robot_that_is_revoked_leaves_its_router(enrolment: Enrolment) -> None:
    enrolment.router("lab")
    enrolment.robot("mbot-1", router="lab")
    assert names(enrolment.revoke("mbot-1")) == ["router lab"]
    enrolment.revoke("lab")
    assert enrolment.folder.roll().revoked == ("mbot-1", "lab")


def refused(act: Callable[[], object]) -> str:
    with pytest.raises((RefusedError, ConfigurationError)) as caught:
        act()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_makes_no_sense_is_refused_and_changes_nothing(enrolment: Enrolment) -> None:
    enrolment.router("lab")
    enrolment.robot("mbot-1", people={"max": [Right.VIEW]}, router="lab")
    before = enrolment.folder.roll()
    e = enrolment
    assert "'max' is a person already" in refused(lambda: e.robot("max"))
    assert "'mbot-1' is a robot already" in refused(lambda: e.router("mbot-1"))
    assert "'lab' is a router" in refused(lambda: e.robot("mbot-1", people={"lab": [Right.VIEW]}))
    assert "expected 1 to 32" in refused(lambda: e.robot("Mbot"))
    assert "expected 1 to 32" in refused(lambda: e.robot("mbot-1", people={"Max": [Right.VIEW]}))
    assert "host is 'a b'" in refused(lambda: e.robot("mbot-1", ["a b"]))
    assert "host is '../x'" in refused(lambda: e.router("lab", ["../x"]))
    assert "no router 'hall'" in refused(lambda: e.robot("mbot-1", router="hall"))
    assert "this workstation itself" in refused(lambda: e.revoke("rosa"))
    assert "mbot-1 would be cut off" in refused(lambda: e.revoke("lab"))
    assert "nobody called 'nick'" in refused(lambda: e.revoke("nick"))
    assert enrolment.folder.roll() == before


def test_a_person_joins_with_the_file_and_sees_only_their_robots(
    enrolment: Enrolment, tmp_path: Path
) -> None:
    enrolment.robot("mbot-1", ["10.0.0.7"], people={"max": [Right.DRIVE]})
    enrolment.robot("mbot-2")
    theirs = Enrolment(FleetFolder(tmp_path / "theirs"))
    roll = theirs.join(enrolment.folder.bundle_path(Kind.PERSON, "max"))
    assert roll.me == "max"
    assert list(roll.robots) == ["mbot-1"]
    assert roll.robots["mbot-1"].people == {"max": (Right.DRIVE,)}
    security = theirs.folder.security("max")
    assert security.key is not None
    assert security.key.read_bytes() == enrolment.folder.identity(Kind.PERSON, "max").key_pem
    assert "cannot enrol anybody" in refused(lambda: theirs.robot("mbot-3"))
    # News of the same fleet are taken, those of another one are not.
    enrolment.robot("mbot-2", people={"max": [Right.VIEW]})
    assert list(theirs.join(enrolment.folder.bundle_path(Kind.PERSON, "max")).robots) == [
        "mbot-1",
        "mbot-2",
    ]
    other = Enrolment(FleetFolder(tmp_path / "other"))
    other.robot("mbot-1", people={"max": [Right.DRIVE]})
    path = other.folder.bundle_path(Kind.PERSON, "max")
    assert "of another fleet already" in refused(lambda: theirs.join(path))
    assert "a fleet of its own" in refused(lambda: enrolment.join(path))


def test_a_tampered_file_cannot_be_joined_by(enrolment: Enrolment, tmp_path: Path) -> None:
    enrolment.robot("mbot-1", people={"max": [Right.DRIVE]})
    path = enrolment.folder.bundle_path(Kind.PERSON, "max")
    with tarfile.open(path) as tar:
        whole = {m.name: (tar.extractfile(m) or io.BytesIO()).read() for m in tar}

    def packed(changes: dict[str, bytes | None]) -> bytes:
        buffer = io.BytesIO()
        with tarfile.open(fileobj=buffer, mode="w") as tar:
            for name, data in (whole | changes).items():
                if data is not None:
                    entry = tarfile.TarInfo(name)
                    entry.size = len(data)
                    tar.addfile(entry, io.BytesIO(data))
        return buffer.getvalue()

    roll = decode_roll(whole[ROLL_FILE], "roll")
    text = msgspec.json.encode(roll)
    assert b'"max"' in text
    stranger = make_authority()
    for data, words in (
        (b"", "not a tar file"),
        (packed(dict.fromkeys(whole)), "has no roll.json"),
        (b"\0" * 100, "not a tar file"),
        (path.read_bytes()[:700], "not a tar file"),
        (b"\0" * (2 << 20), "too many"),
        (packed({ROLL_FILE: b"{}"}), "is not a roll"),
        (packed({ROLL_FILE: text.replace(b'"max"', b'"../../evil"')}), "expected 1 to 32"),
        (packed({ROLL_FILE: text.replace(b'"me":"max"', b'"me":"x"')}), "not among the people"),
        (packed({ROLL_FILE: text.replace(b'"router":""', b'"router":"x"')}), "router of mbot-1"),
        (packed({ROLL_FILE: text.replace(b'["mbot-1.local"]', b"[]")}), "mbot-1 has no hosts"),
        (packed({ROLL_FILE: text.replace(b'"schema":1', b'"schema":2')}), "upgrade it"),
        (packed({"persons/max.key": None}), "has no persons/max.key"),
        (packed({"../evil": b"x"}), "does not belong there"),
        (packed({"authority.pem": stranger.certificate_pem}), "authority do not fit"),
        (packed({"persons/max.key": stranger.key_pem}), "key do not fit"),
        (packed({"persons/max.pem": b"x"}), "do not fit"),
    ):
        assert words in refused(lambda data=data: read_person_bundle(data, "max.tar")), words


@given(st.binary(max_size=2000))
def test_no_file_brings_it_down(data: bytes) -> None:
    with pytest.raises(ConfigurationError):
        read_person_bundle(data, "x.tar")


@given(st.binary(max_size=300))
def test_no_roll_brings_it_down(data: bytes) -> None:
    with pytest.raises(ConfigurationError):
        decode_roll(data, "roll.json")


def test_certificates_are_what_tls_asks_of_them() -> None:
    authority = make_authority(NOW)
    robot = issue(authority, Kind.ROBOT, "mbot-1", ["mbot-1.local"], NOW).certificate
    robot.verify_directly_issued_by(authority.certificate)
    assert robot.not_valid_before_utc == NOW - BACKDATED
    uses = {
        kind: {
            use._name  # pyright: ignore[reportPrivateUsage]
            for use in issue(authority, kind, "x")
            .certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage)
            .value
        }
        for kind in Kind
    }
    # A person's certificate cannot stand for a robot.
    assert uses[Kind.PERSON] == {"clientAuth"}
    assert uses[Kind.ROBOT] == uses[Kind.ROUTER] == {"serverAuth", "clientAuth"}
    constraints = authority.certificate.extensions.get_extension_for_class(x509.BasicConstraints)
    assert (constraints.value.ca, constraints.value.path_length) == (True, 0)


def test_a_users_name_becomes_one_that_a_certificate_can_hold(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for user, name in (
        ("max.muster", "max-muster"),
        ("-x", "x"),
        ("Ä", "me"),
        ("a" * 40, "a" * 32),
    ):
        monkeypatch.setattr(enroll.getpass, "getuser", lambda user=user: user)
        enrolment = Enrolment(FleetFolder(tmp_path / name))
        enrolment.robot("mbot-1")
        assert enrolment.folder.roll().me == name
