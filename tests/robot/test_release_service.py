"""A release over the network: taken in piece by piece, refused for a reason, handed to root."""

import gc
import os
import platform
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import pytest
from google.protobuf.message import Message

from mbot_agent import intake
from mbot_agent.releases.own_release import own_release, update_goes_on
from mbot_agent.releases.release_service import ReleaseService
from mbot_protocol.signing.release_ledger import RESERVE_BYTES, Computer, Ledger, Outcome
from mbot_protocol.v1.messages_pb2 import (
    PushChunk,
    PushCommit,
    PushReply,
    ReleaseBegin,
    ReleaseList,
)
from mbot_protocol.wire.keys import (
    CHUNK_BYTES,
    RELEASE_BEGIN,
    RELEASE_CHUNK,
    RELEASE_COMMIT,
    RELEASES,
)
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.models.signing_key import SigningKey

from .release_bench import KEY, archive, signed_manifest

PI = Computer("bookworm", "arm64", "3.11", 10**10)


class Robot:
    """The service on a disk of its own."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.inbox = folder / "state/inbox"
        self.application = folder / "application"
        (self.application / "releases/0.1").mkdir(parents=True)
        (self.application / "releases/0.1/whole").touch()
        self.armed = False
        self.service = ReleaseService(
            "mbot-1", (KEY.public,), self.inbox, lambda: self.armed, "0.1", self.application
        )
        self.computer = PI
        monkeypatch.setattr(ReleaseService, "_computer", lambda _: self.computer)

    def ask(self, name: str, message: Message) -> PushReply:
        payload = message.SerializeToString()
        return PushReply.FromString(self.service.answers[name](payload))

    def begin(self, path: Path, robot_id: str = "mbot-1") -> PushReply:
        data, signatures = signed_manifest(path)
        return self.ask(
            RELEASE_BEGIN.name,
            ReleaseBegin(
                schema_version=SCHEMA_VERSION,
                robot_id=robot_id,
                manifest=data,
                signatures=signatures,
            ),
        )

    def chunk(self, push_id: str, offset: int, data: bytes) -> PushReply:
        message = PushChunk(
            schema_version=SCHEMA_VERSION, push_id=push_id, offset_bytes=offset, data=data
        )
        return self.ask(RELEASE_CHUNK.name, message)

    def commit(self, push_id: str) -> PushReply:
        message = PushCommit(schema_version=SCHEMA_VERSION, push_id=push_id)
        return self.ask(RELEASE_COMMIT.name, message)

    def send(self, path: Path, data: bytes | None = None) -> PushReply:
        """All of it; the first reply that is no."""
        reply = self.begin(path)
        content = path.read_bytes() if data is None else data
        for offset in range(0, len(content), CHUNK_BYTES):
            if not reply.accepted:
                return reply
            reply = self.chunk(reply.push_id, offset, content[offset : offset + CHUNK_BYTES])
        return self.commit(reply.push_id) if reply.accepted else reply


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    return Robot(tmp_path, monkeypatch)


def test_a_release_is_kept_whole_with_a_request_for_root(robot: Robot, tmp_path: Path) -> None:
    path = archive(tmp_path)
    reply = robot.send(path)
    assert reply.accepted, reply.reason
    assert (robot.inbox / "incoming.tar").read_bytes() == path.read_bytes()
    assert (robot.inbox / "request").read_text() == reply.push_id
    assert robot.begin(path).reason == "an update is under way: wait for its end"
    assert update_goes_on(robot.inbox)


def test_an_armed_robot_takes_none_also_in_the_middle(robot: Robot, tmp_path: Path) -> None:
    path = archive(tmp_path)
    begun = robot.begin(path)
    robot.armed = True
    assert "armed" in robot.chunk(begun.push_id, 0, path.read_bytes()).reason
    assert "armed" in robot.begin(path).reason
    assert not (robot.inbox / "incoming.tar").exists()
    robot.armed = False
    assert "not under way" in robot.commit(begun.push_id).reason
    assert not (robot.inbox / "request").exists()


def test_refusals_come_before_the_first_byte(robot: Robot, tmp_path: Path) -> None:
    stranger = SigningKey.ephemeral("stranger")
    assert "not among" in robot.begin(archive(tmp_path, keys=(stranger,))).reason
    assert "for robot 'mbot-2'" in robot.begin(archive(tmp_path), "mbot-2").reason
    assert "runs on this robot already" in robot.begin(archive(tmp_path, "0.1")).reason
    (robot.application / "ledger.json").write_bytes(Ledger(floor=9).to_bytes())
    assert "downgrade" in robot.begin(archive(tmp_path)).reason
    assert not robot.inbox.exists()


def test_a_checkout_takes_none(robot: Robot, tmp_path: Path) -> None:
    robot.service = ReleaseService(
        "mbot-1", (KEY.public,), robot.inbox, lambda: False, "", robot.application
    )
    assert "deploy/install.sh" in robot.begin(archive(tmp_path)).reason


def test_another_archive_than_announced_is_refused_at_the_end(robot: Robot, tmp_path: Path) -> None:
    path = archive(tmp_path)
    changed = path.read_bytes().replace(b"a wheel", b"a whale", 1)
    assert "is damaged" in robot.send(path, changed).reason
    assert not (robot.inbox / "request").exists()
    assert not (robot.inbox / "incoming.tar").exists()
    assert robot.send(path).accepted


def test_another_release_than_announced_is_refused_at_the_end(robot: Robot, tmp_path: Path) -> None:
    announced, sent = archive(tmp_path), archive(tmp_path, "0.3", 3)
    assert announced.stat().st_size == sent.stat().st_size
    assert "another release than was announced" in robot.send(announced, sent.read_bytes()).reason
    assert not (robot.inbox / "request").exists()


def test_only_its_own_push_goes_on_and_half_of_it_is_not_the_whole(
    robot: Robot, tmp_path: Path
) -> None:
    data = archive(tmp_path).read_bytes()
    begun = robot.begin(tmp_path / "0.2.tar")
    assert "not under way" in robot.chunk("f" * 16, 0, data[:10]).reason
    assert robot.chunk(begun.push_id, 0, data[:10]).received_bytes == 10
    assert f"10 of {len(data)} bytes" in robot.commit(begun.push_id).reason
    assert robot.chunk(begun.push_id, 10, data[10:]).accepted
    assert robot.commit(begun.push_id).received_bytes == len(data)


def test_a_disk_must_hold_the_archive_twice_and_what_it_unpacks_to(
    robot: Robot, tmp_path: Path
) -> None:
    """The daemon's file and the updater's, and the folder where it will run."""
    path = archive(tmp_path)
    needed_bytes = 2 * path.stat().st_size + 1000 + RESERVE_BYTES
    robot.computer = replace(PI, free_bytes=needed_bytes - 1)
    assert "disk is full" in robot.begin(path).reason
    robot.computer = replace(PI, free_bytes=needed_bytes)
    assert robot.begin(path).accepted


def test_what_is_received_is_nobody_elses_to_read_or_change(robot: Robot, tmp_path: Path) -> None:
    robot.begin(archive(tmp_path))
    assert robot.inbox.stat().st_mode & 0o777 == 0o700
    assert (robot.inbox / "incoming.tar").stat().st_mode & 0o777 == 0o600


def test_the_request_comes_after_the_archive_has_reached_the_disk(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a power cut the updater finds all of it, or is asked for nothing."""
    path = archive(tmp_path)
    synced: list[tuple[str, int]] = []
    whole = os.fsync

    def fsync(descriptor: int) -> None:
        if not (robot.inbox / "request").exists():
            name = Path(f"/proc/self/fd/{descriptor}").readlink().name
            synced.append((name, os.fstat(descriptor).st_size))
        whole(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    data, begun = path.read_bytes(), robot.begin(path)
    robot.chunk(begun.push_id, 0, data[:-10])
    robot.chunk(begun.push_id, len(data) - 10, data[-10:])
    assert robot.commit(begun.push_id).accepted
    assert synced[0] == ("incoming.tar", len(data))


def test_a_disk_that_refuses_is_a_reason(robot: Robot, tmp_path: Path) -> None:
    robot.inbox.parent.write_text("in the way")
    assert "cannot keep the release in" in robot.begin(archive(tmp_path)).reason


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_push_leaves_no_file_open_however_it_ends(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = archive(tmp_path)
    gc.collect()  # what other tests have left half sent
    before = open_files()
    with warnings.catch_warnings(record=True) as left_to_the_collector:
        warnings.simplefilter("always", ResourceWarning)
        robot.begin(path)
        robot.armed = True
        robot.begin(path)
        robot.armed = False
        assert open_files() == before, "given up"
        assert robot.send(path).accepted
        assert open_files() == before, "whole"
        (robot.inbox / "request").unlink()  # as the updater does when it has taken it
        assert robot.begin(path).accepted
        later_s = time.monotonic() + intake.EXPIRES_S + 1
        monkeypatch.setattr(time, "monotonic", lambda: later_s)
        assert not robot.begin(path, "mbot-2").accepted
        assert robot.begin(archive(tmp_path, "0.1")).reason
        assert open_files() == before, "forgotten"
        assert not (robot.inbox / "incoming.tar").exists()
    assert left_to_the_collector == []


def test_a_robot_knows_what_it_is(tmp_path: Path) -> None:
    service = ReleaseService("mbot-1", (), tmp_path, lambda: False, "0.1", tmp_path)
    found = service._computer()  # pyright: ignore[reportPrivateUsage]
    assert found.system == platform.freedesktop_os_release().get("VERSION_CODENAME", "unknown")
    assert found.architecture in ("amd64", "arm64")  # as Debian calls them
    assert found.python == ".".join(platform.python_version_tuple()[:2])
    assert found.free_bytes > 0


def test_half_a_release_of_an_earlier_start_is_swept_and_a_whole_one_is_not(
    robot: Robot, tmp_path: Path
) -> None:
    robot.begin(archive(tmp_path))
    robot.service.sweep()
    assert not (robot.inbox / "incoming.tar").exists()
    (robot.inbox / "incoming.tar").write_bytes(b"whole")
    (robot.inbox / "request").write_text("a1")
    robot.service.sweep()
    assert (robot.inbox / "incoming.tar").exists()


def test_the_list_says_what_became_of_the_last_update(robot: Robot) -> None:
    outcome = Outcome("a1", "0.2", "rolled-back", "no READY")
    (robot.application / "releases/0.0").mkdir()
    (robot.application / "releases/0.0/whole").touch()
    (robot.application / "ledger.json").write_bytes(
        Ledger(golden="0.0", previous="0.1", outcome=outcome).to_bytes()
    )
    reply = ReleaseList.FromString(robot.service.answers[RELEASES.name](b""))
    assert (reply.accepted, reply.running) == (True, "0.1")
    found = [(one.version, one.golden, one.previous) for one in reply.releases]
    assert found == [("0.0", True, False), ("0.1", False, True)]
    update = reply.update
    assert (update.request, update.version, update.phase) == ("a1", "0.2", "rolled-back")
    assert (update.detail, update.goes_on) == ("no READY", False)
    robot.inbox.mkdir(parents=True)
    (robot.inbox / "request").touch()
    reply = ReleaseList.FromString(robot.service.answers[RELEASES.name](b""))
    assert reply.update.goes_on
    (robot.application / "ledger.json").write_bytes(b"x")
    assert "unreadable" in ReleaseList.FromString(robot.service.releases(b"")).reason


@pytest.mark.parametrize("payload", [b"", b"\xff\xff", b"x" * 60_000])
def test_rubbish_is_refused(robot: Robot, payload: bytes) -> None:
    for name in (RELEASE_BEGIN.name, RELEASE_CHUNK.name, RELEASE_COMMIT.name):
        assert not PushReply.FromString(robot.service.answers[name](payload)).accepted


def test_a_daemon_knows_its_release_by_its_place(tmp_path: Path) -> None:
    assert own_release("/opt/mbot-agent/releases/0.2+a/venv") == "0.2+a"
    assert own_release("/usr") == ""
    assert not update_goes_on(tmp_path, tmp_path / "works")
    (tmp_path / "works").mkdir()
    assert update_goes_on(tmp_path, tmp_path / "works")


def test_the_standing_daemon_loads_nothing_for_it() -> None:
    """Memory: what only an update needs is imported by the updater, not by the daemon."""
    code = "import sys, mbot_agent.releases.release_service; print('mbot_update' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
