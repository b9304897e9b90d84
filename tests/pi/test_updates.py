"""Releases on a booted machine: installed, updated, refused, rolled back, cut off in between."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mbot_protocol.errors import MbotError, RefusedError
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases.send_release import (
    check_release_file,
    send,
    wait_for_outcome,
)

from ..end_to_end.processes import until
from ..reliability.motion import FORWARD
from .booted import CHECKOUT, INSIDE, Machine
from .conftest import SERVICE, Robot
from .release_variants import CURIOUS, DYING, NOT_READY, NOT_STARTING, Releases

Record = Callable[[str, object], None]
FOLDER = CHECKOUT / "out" / "pi-releases"
FIRST, SECOND = "0.1.0+first", "0.1.0+second"
KEY = SigningKey.ephemeral("releases")


@pytest.fixture(scope="module", params=["bookworm", "trixie"])
def releases(request: pytest.FixtureRequest) -> Releases:
    return Releases(FOLDER, request.param)


@pytest.fixture(scope="module")
def robot(releases: Releases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """Installed from a release, configured and started, with a model."""
    directory = tmp_path_factory.mktemp("updates")
    archive = releases.make(FIRST, 1, KEY)
    with Machine(releases.system, directory) as machine:
        made = Robot(machine, directory, from_archive(INSIDE / archive.relative_to(CHECKOUT)))
        made.configuration = made.configuration.replace(
            "[trust]", f'[trust]\n            release_keys = ["{KEY.public.line}"]'
        )
        with made.board, made.daemon.camera():
            yield made


@pytest.fixture(scope="module")
def started(robot: Robot) -> Robot:
    assert robot.installed.returncode == 0, robot.installed.stdout + robot.installed.stderr
    robot.configure()
    robot.start()
    robot.daemon.push(FORWARD)
    assert until(robot.daemon.is_ready)
    return robot


def from_archive(archive: Path) -> tuple[str, ...]:
    """Nothing of a checkout is needed."""
    unpacked = "/tmp/release"
    script = f"mkdir {unpacked} && tar -C {unpacked} -xf {archive} deploy updater"
    return "sh", "-c", f"{script} && {unpacked}/deploy/install.sh --without-picamera2 {archive}"


def known(robot: Robot) -> dict[str, Any]:
    return json.loads(robot.machine.says("mbot-agent", "releases", "--json"))


def running(robot: Robot) -> str:
    return robot.daemon.status().release


def sent(robot: Robot, archive: Path) -> tuple[str, str]:
    """What became of a release: phase and detail.

    An updater that has just gone back still deletes what it went back from.
    """
    at_work = "/run/mbot-agent-update"
    assert until(lambda: robot.machine.run("test", "-e", at_work).returncode != 0, 60)
    with robot.daemon.link() as link:
        number = send(link, check_release_file(archive), lambda _sent, _all: None)
        update = wait_for_outcome(link, number, lambda _: None)
    return update.phase, update.detail


def test_a_release_is_installed_and_runs(started: Robot, record_property: Record) -> None:
    record_property("installed in s", round(started.install_s, 1))
    assert running(started) == FIRST
    assert started.machine.says("readlink", "/opt/mbot-agent/current") == f"releases/{FIRST}"
    size_mb = int(started.machine.says("du", "-sm", f"/opt/mbot-agent/releases/{FIRST}").split()[0])
    record_property("disk MB", size_mb)
    assert started.shows("UnitFileState") in ("enabled", "linked")
    assert started.machine.run("systemctl", "is-enabled", SERVICE).returncode == 0


def test_a_person_updates_it_by_the_command(
    started: Robot, releases: Releases, record_property: Record
) -> None:
    archive = releases.make(SECOND, 2, KEY)
    began_s = time.monotonic()
    command = ["-m", "mbot_workstation.main", "update", str(archive), "--json"]
    done = subprocess.run(
        [sys.executable, *command, "--robot", started.daemon.address],
        capture_output=True,
        text=True,
        check=False,
    )
    record_property("updated in s", round(time.monotonic() - began_s, 1))
    assert done.returncode == 0, done.stderr + update_journal(started)
    assert json.loads(done.stdout)["outcome"] == "installed"
    assert running(started) == SECOND
    assert until(started.daemon.is_ready)
    found = known(started)
    assert [row["version"] for row in found["releases"] if row["golden"]] == [FIRST]


def test_one_that_does_not_import_never_replaces_what_runs(
    started: Robot, releases: Releases
) -> None:
    pid = started.main_pid()
    phase, detail = sent(started, releases.make("0.1.0+broken", 3, KEY, NOT_STARTING))
    assert phase == "refused"
    assert "does not import" in detail
    assert started.main_pid() == pid
    assert running(started) == SECOND


def test_one_that_is_tried_reaches_nothing(started: Robot, releases: Releases) -> None:
    started.machine.says("touch", "/dev/ttyUSB0")
    phase, detail = sent(started, releases.make("0.1.0+curious", 3, KEY, CURIOUS))
    started.machine.says("rm", "/dev/ttyUSB0")
    assert phase == "refused"
    user = started.machine.says("id", "-u", "mbot-agent")
    assert f"as {user} it reached []" in detail


def test_one_that_gets_no_ready_is_rolled_back_and_not_taken_again(
    started: Robot, releases: Releases, record_property: Record
) -> None:
    archive = releases.make("0.1.0+mute", 4, KEY, NOT_READY)
    began_s = time.monotonic()
    assert sent(started, archive)[0] == "rolled-back", update_journal(started)
    record_property("rolled back after s", round(time.monotonic() - began_s, 1))
    assert running(started) == SECOND
    with pytest.raises(RefusedError, match="was rolled back on this robot before"):
        sent(started, archive)
    assert "not taken again: it did not get READY" in started.machine.says("mbot-agent", "releases")


def test_refusals_are_one_line(started: Robot, releases: Releases) -> None:
    stranger = SigningKey.ephemeral("stranger")
    with pytest.raises(RefusedError, match="not among this robot's"):
        sent(started, releases.make("0.1.0+strange", 9, stranger))
    with pytest.raises(RefusedError, match="below 2"):
        sent(started, releases.make("0.1.0+old", 1, KEY))
    mark = f"/opt/mbot-agent/releases/{SECOND}/whole"
    started.machine.says("touch", "-d", "2 hours", mark)
    phase, detail = sent(started, releases.make("0.1.0+early", 9, KEY))
    started.machine.says("touch", mark)
    assert phase == "refused"
    assert "the robot's clock is wrong" in detail
    started.daemon.run()
    with pytest.raises(RefusedError, match="armed"):
        sent(started, releases.make("0.1.0+armed", 9, KEY))
    with started.daemon.link() as link:
        from mbot_workstation.fleet.link.remote_control import RemoteControl

        RemoteControl(link).stop()


def test_one_that_dies_later_is_put_back_by_systemd_alone(
    started: Robot, releases: Releases, record_property: Record
) -> None:
    assert sent(started, releases.make("0.1.0+dying", 5, KEY, DYING))[0] == "installed"
    began_s = time.monotonic()
    assert until(lambda: last(started)["phase"] == "rolled-back", 250), started.journal()
    after_s = time.monotonic() - began_s
    record_property("put back after s", round(after_s, 1))
    assert after_s > 60  # ten deaths, 12 s after each start
    assert until(started.daemon.is_ready, 30)
    assert running(started) == SECOND


def test_one_that_dies_slowly_is_put_back_at_its_tenth_death(
    started: Robot, releases: Releases
) -> None:
    """The nine before are written down, not waited for."""
    slow = "0.1.0+slow"
    assert sent(started, releases.make(slow, 6, KEY))[0] == "installed"
    assert until(started.daemon.is_ready, 30)
    started.signal(signal.SIGKILL)
    lives = started.machine.root / "opt/mbot-agent/lives"
    assert until(lives.exists), update_journal(started)
    assert lives.read_text() == f"{slow} 1\n"
    lives.write_text(f"{slow} 9\n")
    assert until(started.daemon.is_ready, 30)
    started.signal(signal.SIGKILL)
    assert until(lambda: last(started)["phase"] == "rolled-back", 60), started.journal()
    assert until(lambda: running_is(started, SECOND), 30)
    assert until(started.daemon.is_ready, 30)


def test_a_person_goes_back_and_forth(started: Robot, record_property: Record) -> None:
    said: list[str] = []

    def rolls_back() -> bool:
        """Refused while the updater still deletes a release."""
        done = started.machine.run("mbot-agent", "rollback")
        said.append(done.stdout + done.stderr)
        return done.returncode == 0

    assert until(rolls_back, 60)
    assert running(started) == FIRST
    assert until(rolls_back, 60)
    assert running(started) == SECOND
    listed = started.machine.says("mbot-agent", "releases")
    record_property("rollback says", said)
    record_property("releases says", listed)
    assert "previous, golden" in listed


def test_a_killed_updater_is_tidied_up_after(started: Robot, releases: Releases) -> None:
    archive = releases.make("0.1.0+killed", 7, KEY)
    with started.daemon.link() as link:
        number = send(link, check_release_file(archive), lambda _sent, _all: None)
        assert until(lambda: phase_on_disk(started) == "trying", 60)
        started.machine.says("systemctl", "kill", "-s", "KILL", "mbot-agent-update")
        update = wait_for_outcome(link, number, lambda _: None)
    assert update.phase == "failed"
    assert "interrupted while trying" in update.detail
    assert until(lambda: running_is(started, SECOND), 30)
    assert until(started.daemon.is_ready, 30)


CUTS = (
    *(("checking", 0.0), ("checking", 0.3), ("building", 0.0), ("building", 2.0)),
    *(("building", 5.0), ("trying", 0.0), ("trying", 0.3), ("trying", 1.5), ("trying", 4.0)),
    ("trying", 9.0),
)
"""Phase, and seconds after its beginning."""


def test_a_power_cut_at_any_moment_leaves_a_whole_release(
    started: Robot, releases: Releases, record_property: Record
) -> None:
    machine = started.machine
    runs, offered, sequence = SECOND, "0.1.0+cut8", 8
    archive = releases.make(offered, sequence, KEY)
    ends: list[str] = []
    for phase, later_s in CUTS:
        with started.daemon.link() as link:
            send(link, check_release_file(archive), lambda _sent, _all: None)
            # Closing the link takes longer than the first phase.
            assert until(lambda phase=phase: phase_on_disk(started) == phase, 60), (phase, ends)
            time.sleep(later_s)
            machine.cut_power()
        machine.__enter__()
        whole = (runs, offered)
        assert until(lambda whole=whole: running_is(started, *whole), 40), update_journal(started)
        state = machine.run("systemctl", "is-active", "mbot-agent-update.path").stdout.strip()
        assert state == "active"
        assert last(started)["phase"] in ("failed", "installed"), phase
        assert not machine.run("ls", "/opt/mbot-agent/incoming").stdout
        ends.append(running(started))
        if ends[-1] == offered:  # it was quick enough to be accepted, and is not taken twice
            runs, sequence = offered, sequence + 1
            offered = f"0.1.0+cut{sequence}"
            archive = releases.make(offered, sequence, KEY)
    record_property("ends", ends)
    assert len(ends) == 10
    assert ends[:6] == [SECOND] * 6


def test_after_a_purge_nothing_is_left(started: Robot) -> None:
    script = str(INSIDE / "deploy/install.sh")
    done = started.machine.run(script, "--uninstall", "--purge")
    assert done.returncode == 0, done.stdout + done.stderr
    left = started.machine.files() - started.files_before
    backups = {"/etc/passwd-", "/etc/group-", "/etc/shadow-", "/etc/gshadow-"}  # userdel's own
    assert left - backups == set()


def phase_on_disk(robot: Robot) -> str:
    return str(json.loads(robot.machine.read("/opt/mbot-agent/ledger.json"))["outcome"]["phase"])


def running_is(robot: Robot, *versions: str) -> bool:
    try:
        return running(robot) in versions
    except MbotError:
        return False


def last(robot: Robot) -> dict[str, str]:
    return known(robot)["last_update"]


def update_journal(robot: Robot) -> str:
    return robot.machine.says("journalctl", "-u", "mbot-agent-update", "--no-pager", "-o", "cat")
