"""What the daemon leaves for root, and why nothing of it is believed."""

import errno
import os
import re
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.release_ledger import RESERVE_BYTES, Computer
from mbot_update import main, taking_in, update_steps
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases.make_release import UPDATER_MODULES, put_updater

from ..ran import ran
from .release_bench import COMPUTER, FILES, Robot, archive, signed_manifest


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    made = Robot(tmp_path / "root", monkeypatch)
    made.runs("0.1")
    return made


def refused(robot: Robot) -> str:
    outcome = update_steps.work(robot.folders)
    assert outcome.phase == "refused"
    assert robot.folders.current == "0.1"
    assert robot.folders.versions() == ["0.1"]
    assert not (robot.folders.inbox / "request").is_symlink()
    assert not (robot.folders.inbox / "request").exists()
    assert not robot.folders.incoming.exists()
    return outcome.detail


def test_a_stranger_a_changed_byte_and_another_system_are_refused(
    robot: Robot, tmp_path: Path
) -> None:
    robot.receives(archive(tmp_path, keys=(SigningKey.ephemeral("stranger"),)))
    assert "not among this robot's [trust] release_keys" in refused(robot)
    good = archive(tmp_path)
    good.write_bytes(good.read_bytes().replace(b"a wheel", b"a whale", 1))
    robot.receives(good)
    assert "mbot_agent-0.1.0-py3-none-any.whl in the archive is damaged" in refused(robot)
    robot.receives(archive(tmp_path, change=lambda m: replace(m, system="trixie")))
    assert "the release is for trixie on arm64" in refused(robot)
    robot.receives(archive(tmp_path, "0.0", 0))
    assert "is a downgrade: its sequence 0 is below 1" in refused(robot)
    robot.receives(archive(tmp_path, "0.1", 1))
    assert "0.1 runs on this robot already" in refused(robot)


def test_a_clock_behind_what_runs_is_wrong(robot: Robot, tmp_path: Path) -> None:
    mark = robot.folders.release("0.1") / "whole"
    now_s = time.time()
    os.utime(mark, (now_s + 2 * 3600, now_s + 2 * 3600))
    robot.receives(archive(tmp_path))
    assert "the robot's clock is wrong: it says 2" in refused(robot)
    os.utime(mark, (now_s + 600, now_s + 600))  # a time server has set it back a little
    robot.receives(archive(tmp_path))
    assert update_steps.work(robot.folders).phase == "installed"


def test_without_keys_nothing_is_taken(robot: Robot, tmp_path: Path) -> None:
    robot.folders.configuration.write_text("[trust]\n")
    robot.receives(archive(tmp_path))
    assert "trusts no key for releases" in refused(robot)


def test_links_and_devices_in_the_inbox_are_not_followed(robot: Robot, tmp_path: Path) -> None:
    good = archive(tmp_path)
    inbox = robot.folders.inbox
    robot.receives(good)
    (inbox / "incoming.tar").unlink()
    (inbox / "incoming.tar").symlink_to(good)
    assert "incoming.tar" in refused(robot)
    robot.receives(good)
    (inbox / "request").unlink()
    os.mkfifo(inbox / "request")
    assert "plain file" in refused(robot)
    robot.receives(good, "../../x")
    assert "damaged" in refused(robot)
    elsewhere = tmp_path / "elsewhere"
    inbox.rename(elsewhere)
    inbox.symlink_to(elsewhere)
    (elsewhere / "request").write_text("a1")
    assert update_steps.work(robot.folders).phase == "refused"
    assert (elsewhere / "request").exists()  # not root's to delete


def test_root_may_install_by_hand_what_the_network_may_not(robot: Robot, tmp_path: Path) -> None:
    robot.folders.note(robot.folders.ledger.with_rejected("0.0", "died"))
    path = archive(tmp_path, "0.0", 0, keys=())
    with path.open("rb") as file:
        assert update_steps.update(robot.folders, file).phase == "installed"
    assert robot.folders.current == "0.0"
    assert "0.0" not in robot.folders.ledger.rejected


def test_what_is_built_is_what_was_verified(robot: Robot, tmp_path: Path) -> None:
    """The daemon may change its own files at any time; root reads them once."""
    path = archive(tmp_path)
    robot.receives(path)
    inbox_file = robot.folders.inbox / "incoming.tar"

    def change(_: str) -> None:
        if inbox_file.exists():
            inbox_file.write_bytes(b"x")

    robot.system.before = change
    assert update_steps.work(robot.folders).phase == "installed"
    own = robot.folders.release("0.2") / "manifest.json"
    assert own.read_bytes() in path.read_bytes()


def test_the_boards_firmware_is_there_for_whoever_flashes_it(robot: Robot, tmp_path: Path) -> None:
    robot.receives(archive(tmp_path))
    assert update_steps.work(robot.folders).phase == "installed"
    current = robot.folders.release("0.2").parents[1] / "current"
    assert (current / "firmware/mbot-deadman.hex").read_bytes() == b":00000001FF\n"


def test_a_build_that_fails_leaves_nothing(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = robot.system.build

    def build(command: list[str], timeout_s: float) -> str:
        return "no space left" if "compileall" in command else whole(command, timeout_s)

    monkeypatch.setattr(taking_in.system, "build", build)
    robot.receives(archive(tmp_path))
    assert "0.2 can't be built here: no space left" in refused(robot)
    with pytest.raises(RefusedError, match="no space left"):
        by_hand(robot, archive(tmp_path))
    assert not robot.folders.release("0.2").exists()


def by_hand(robot: Robot, path: Path) -> str:
    with path.open("rb") as file:
        return update_steps.update(robot.folders, file).phase


def test_a_disk_must_hold_what_is_unpacked_and_what_is_built(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = archive(tmp_path)
    files_bytes = sum(map(len, FILES.values()))
    free_bytes = files_bytes + 1000 + RESERVE_BYTES - 1

    def computer(_: Path) -> Computer:
        return replace(COMPUTER, free_bytes=free_bytes)

    monkeypatch.setattr(taking_in.system, "computer", computer)
    with pytest.raises(RefusedError, match="disk is full"):
        by_hand(robot, path)
    free_bytes += 1
    assert by_hand(robot, path) == "installed"
    update_steps.put_back_by_hand(robot.folders)
    free_bytes -= 1000  # it is built already
    assert by_hand(robot, path) == "installed"
    update_steps.put_back_by_hand(robot.folders)
    free_bytes -= 1
    with pytest.raises(RefusedError, match="disk is full"):
        by_hand(robot, path)


def test_one_that_is_there_already_is_not_built_again_and_none_takes_its_name(
    robot: Robot, tmp_path: Path
) -> None:
    (tmp_path / "other").mkdir()
    path, other = archive(tmp_path), archive(tmp_path / "other", sequence=3)
    assert by_hand(robot, path) == "installed"
    update_steps.put_back_by_hand(robot.folders)
    steps: list[str] = []
    robot.system.before = steps.append
    assert by_hand(robot, path) == "installed"
    assert "build" not in steps
    update_steps.put_back_by_hand(robot.folders)
    with pytest.raises(RefusedError, match=r"another release of the name 0\.2"):
        by_hand(robot, other)
    (robot.folders.release("0.2") / "manifest.json").unlink()  # one that root has checked out
    with pytest.raises(RefusedError, match=r"another release of the name 0\.2"):
        by_hand(robot, path)


def test_what_an_earlier_update_left_is_none_of_this_one(robot: Robot, tmp_path: Path) -> None:
    for left in (robot.folders.incoming / "wheels", robot.folders.release("0.2") / "venv"):
        left.mkdir(parents=True)
        (left / "left.whl").write_bytes(b"not of this release")
    assert by_hand(robot, archive(tmp_path)) == "installed"
    assert list(robot.folders.release("0.2").rglob("left.whl")) == []
    assert not robot.folders.incoming.exists()


def test_a_release_lies_there_as_root_would_lay_it(robot: Robot, tmp_path: Path) -> None:
    """Compiled, since the service may write nothing there; open only while it is not root's own."""
    commands: list[str] = []
    modes: list[int] = []
    whole = robot.system.build

    def build(command: list[str], timeout_s: float) -> str:
        commands.append(" ".join(command))
        modes.append(robot.folders.incoming.stat().st_mode & 0o777)
        return whole(command, timeout_s)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(taking_in.system, "build", build)
        assert by_hand(robot, archive(tmp_path)) == "installed"
    assert set(modes) == {0o700}
    release = robot.folders.release("0.2")
    assert f"{release}/venv/bin/python -I -m compileall -q {release}/venv/lib" in commands
    expected = {"deploy/install.sh": 0o755, "deploy/systemd/mbot-agent.service": 0o644}
    for name, mode in expected.items():
        assert (release / name).stat().st_mode & 0o777 == mode
    said = signed_manifest(archive(tmp_path))
    (package,) = (release / "venv/lib").glob("python3.*/site-packages/mbot_agent/main.py")
    assert package.read_bytes().startswith(b"# a wheel")
    assert said == tuple((release / f"manifest.{end}").read_bytes() for end in ("json", "sig"))


def test_a_release_without_a_firmware_is_one(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(FILES, "firmware/mbot-deadman.hex")
    monkeypatch.setitem(FILES, "deploy/about/a/folder.txt", b"that comes first")
    assert by_hand(robot, archive(tmp_path)) == "installed"
    assert not (robot.folders.release("0.2") / "firmware").exists()
    assert (robot.folders.release("0.2") / "deploy/about/a/folder.txt").exists()


def test_a_disk_that_refuses_while_it_is_unpacked_is_a_reason(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "chmod", full)
    robot.receives(archive(tmp_path))
    assert refused(robot) == "cannot take the release in: No space left on device"


@pytest.mark.parametrize("kind", ["fifo", "file", "nothing"])
def test_an_inbox_that_is_no_folder_holds_nothing_up(robot: Robot, kind: str) -> None:
    inbox = robot.folders.inbox
    inbox.rmdir()
    {"fifo": lambda: os.mkfifo(inbox), "file": inbox.touch, "nothing": lambda: None}[kind]()
    assert not taking_in.is_asked(robot.folders)
    assert update_steps.work(robot.folders) == robot.folders.ledger.outcome
    with pytest.raises(RefusedError, match="there is no release in"):
        taking_in.open_request(robot.folders)


def test_an_update_leaves_no_file_open(robot: Robot, tmp_path: Path) -> None:
    def open_files() -> int:
        return len(list(Path("/proc/self/fd").iterdir()))

    before = open_files()
    robot.receives(archive(tmp_path))
    assert update_steps.work(robot.folders).phase == "installed"
    os.mkfifo(robot.folders.inbox / "request")
    assert update_steps.work(robot.folders).phase == "refused"
    assert open_files() == before


def test_the_updater_runs_with_the_systems_python_alone(tmp_path: Path) -> None:
    put_updater(tmp_path / "updater")
    (tmp_path / "opt/mbot-agent/releases").mkdir(parents=True)
    command = [sys.executable, "-I", "-S", "-B", "-X", "importtime", str(tmp_path / "updater")]
    command += ["--root", str(tmp_path), "releases", "--json"]
    done = ran(*command)
    assert done.returncode == 0, done.stderr
    assert '"releases": []' in done.stdout
    imported = set(re.findall(r"\| +mbot_protocol\.([\w.]+)$", done.stderr, re.MULTILINE))
    listed = {
        name.replace("/", ".").removesuffix("__init__").rstrip(".")
        for name in UPDATER_MODULES.read_text().split()
    }
    assert imported | {""} == listed
    names = {path.name for path in (tmp_path / "updater/mbot_update").glob("*.py")}
    assert Path(main.__file__).name in names


def test_one_updater_at_a_time(robot: Robot) -> None:
    alone = main._alone  # pyright: ignore[reportPrivateUsage]
    with (
        alone(robot.folders),
        pytest.raises(RefusedError, match="under way"),
        alone(robot.folders),
    ):
        pass
