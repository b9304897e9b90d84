"""From installing to purging, on booted machines: each test leaves the next one a robot to use."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mbot_workstation.link.remote_control import RemoteControl

from ..end_to_end.processes import Process, until
from ..reliability.motion import FORWARD, FORWARD_BOARD, driven_since, stopped_s
from .booted import INSIDE
from .conftest import CONFIGURATION, INSTALL, INSTALL_S, SERVICE, Robot

Record = Callable[[str, object], None]
MEMORY_MB = 110
"""Resident, while it drives with a policy that has no memory of its own."""

PC_BAR_MB = 290
"""A PC's libraries are larger than a Pi's, whose bar is in test_release_size.py."""


def forget_cached_files() -> None:
    """As after a boot. Libraries that were written a moment ago lie in the cache in large pieces,
    all of which count as the daemon's memory when it touches one page: 40 MB more on Trixie."""
    os.sync()
    Path("/proc/sys/vm/drop_caches").write_text("3")


@pytest.fixture
def driving(robot: Robot, camera: Process) -> Iterator[Robot]:
    """The service is up, has a model and drives."""
    assert camera.is_running()
    if robot.state() != "active":
        robot.start()
    robot.daemon.push(FORWARD)
    assert until(robot.daemon.is_ready)
    robot.daemon.run()
    assert robot.board.wait_for(*FORWARD_BOARD, timeout_s=15), robot.journal()
    # Three starts with a model that is still on trial would take it for the culprit.
    assert until(lambda: robot.daemon.status().active_model.proven, 20)
    yield robot
    if robot.state() == "active":
        with robot.daemon.link() as link:
            RemoteControl(link).stop()


def test_the_script_installs_and_starts_nothing(robot: Robot, record_property: Record) -> None:
    record_property("installed in s", round(robot.install_s, 1))
    done = robot.installed
    assert done.returncode == 0, done.stdout + done.stderr
    assert "sudo systemctl start mbot-agent" in done.stdout
    assert robot.state() == "inactive"
    assert robot.shows("UnitFileState") == "enabled"
    machine = robot.machine
    assert machine.says("stat", "-c", "%U:%G %a", CONFIGURATION) == "root:mbot-agent 640"
    assert machine.says("stat", "-c", "%U %a", "/var/lib/mbot-agent") == "mbot-agent 700"
    size_mb = int(machine.says("du", "-sm", "/opt/mbot-agent").split()[0])
    record_property("disk MB", size_mb)
    assert size_mb < PC_BAR_MB
    assert machine.run("ls", "/opt/mbot-agent/current/venv/bin/pip").returncode != 0


def test_the_unit_is_hardened_and_faultless(robot: Robot, record_property: Record) -> None:
    unit = "/etc/systemd/system/mbot-agent.service"
    verified = robot.machine.run("systemd-analyze", "verify", "--man=no", unit)
    assert verified.returncode == 0
    assert verified.stdout + verified.stderr == ""
    arguments = ("systemd-analyze", "security", "--offline=true", "--threshold=15", unit)
    judged = robot.machine.run(*arguments)
    assert judged.returncode == 0, judged.stdout
    record_property("exposure", judged.stdout.strip().splitlines()[-1].split(":")[-1].strip())


def test_a_wrong_configuration_is_one_line_and_no_loop(robot: Robot) -> None:
    wrong = robot.configuration.replace("robot_id", "robot_name")
    robot.machine.write(CONFIGURATION, wrong)
    assert robot.machine.run("systemctl", "start", SERVICE).returncode != 0
    assert robot.shows("ExecMainStatus") == "2"
    assert until(lambda: robot.state() == "failed")
    assert robot.shows("NRestarts") == "0"
    assert "Traceback" not in robot.journal()
    assert "robot_name" in robot.journal()


def test_it_starts_quickly_and_drives(
    robot: Robot, camera: Process, record_property: Record
) -> None:
    assert camera.is_running()
    robot.configure()
    forget_cached_files()
    robot.start()
    began_us, ready_us = (
        int(robot.shows(name))
        for name in ("ExecMainStartTimestampMonotonic", "ActiveEnterTimestampMonotonic")
    )
    record_property("start to READY s", (ready_us - began_us) / 1e6)
    assert (ready_us - began_us) / 1e6 <= 5.0
    robot.daemon.push(FORWARD)
    assert until(robot.daemon.is_ready)
    assert not robot.board.moved
    robot.daemon.run()
    assert robot.board.wait_for(*FORWARD_BOARD, timeout_s=15), robot.journal()
    time.sleep(5.0)  # some decisions: then its memory is what it stays
    status = robot.machine.says("cat", f"/proc/{robot.main_pid()}/status")
    resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    memory_mb = int(resident.split()[1]) / 1024
    record_property("memory MB", round(memory_mb))
    assert memory_mb <= MEMORY_MB


def test_stop_is_quick(driving: Robot, record_property: Record) -> None:
    began_s = time.monotonic()
    driving.machine.says("systemctl", "stop", SERVICE)
    after_s = stopped_s(driving.board, began_s) - began_s
    record_property("stopped after s", round(after_s, 3))
    assert after_s <= 0.5
    assert driving.state() == "inactive"
    assert driving.board.speeds == (0, 0)


def test_a_killed_daemon_stops_the_wheels_and_is_there_again_standing(
    driving: Robot, record_property: Record
) -> None:
    began_s = time.monotonic()
    driving.signal(signal.SIGKILL)
    assert until(lambda: driving.board.speeds == (0, 0))
    after_s = stopped_s(driving.board, began_s) - began_s
    record_property("stopped after s", round(after_s, 3))
    assert after_s <= 1.0
    assert until(driving.daemon.is_ready, 20)
    record_property("there again s", round(time.monotonic() - began_s, 1))
    time.sleep(2.0)
    assert driven_since(driving.board, began_s + after_s) == 0


def test_a_frozen_daemon_is_ended_by_the_watchdog(driving: Robot, record_property: Record) -> None:
    began_s = time.monotonic()
    driving.signal(signal.SIGSTOP)
    assert until(lambda: driving.board.speeds == (0, 0), 15)
    after_s = stopped_s(driving.board, began_s) - began_s
    record_property("stopped after s", round(after_s, 2))
    assert after_s <= 8.5  # WatchdogSec and TimeoutAbortSec; the board's firmware takes 0.3 s
    assert until(driving.daemon.is_ready, 30), driving.journal()
    assert driven_since(driving.board, began_s + after_s) == 0


def test_a_daemon_that_dies_at_once_stays_down_after_ten_starts(robot: Robot) -> None:
    drop_in = f"/etc/systemd/system/{SERVICE}.service.d/dies.conf"
    robot.machine.says("mkdir", "-p", drop_in.rpartition("/")[0])
    robot.machine.write(drop_in, "[Service]\nExecStart=\nExecStart=/bin/false\n")
    try:
        robot.machine.says("systemctl", "daemon-reload")
        robot.machine.run("systemctl", "reset-failed", SERVICE)  # starts of other tests count too
        robot.machine.run("systemctl", "restart", SERVICE)
        # Its state is "failed" for a moment between two starts, too.
        assert until(lambda: "Start request repeated too quickly" in robot.journal(), 60)
        assert robot.state() == "failed"
        assert int(robot.shows("NRestarts")) >= 9
    finally:
        robot.machine.says("rm", "-r", drop_in.rpartition("/")[0])
        robot.machine.says("systemctl", "daemon-reload")
    robot.start()


def test_installing_again_keeps_the_configuration_and_the_models(robot: Robot) -> None:
    before = robot.daemon.status().active_model.sha256
    assert before
    done = robot.machine.run(*INSTALL, timeout_s=INSTALL_S)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "was running and runs again" in done.stdout
    assert robot.machine.read(CONFIGURATION) == robot.configuration
    assert robot.state() == "active"
    assert robot.daemon.status().active_model.sha256 == before


def test_after_a_purge_nothing_is_left(robot: Robot) -> None:
    robot.edit_units()
    script = str(INSIDE / "deploy/install.sh")
    done = robot.machine.run(script, "--uninstall", "--purge")
    assert done.returncode == 0, done.stdout + done.stderr
    left = robot.machine.files() - robot.files_before
    backups = {"/etc/passwd-", "/etc/group-", "/etc/shadow-", "/etc/gshadow-"}  # userdel's own
    assert left - backups == set()
    assert robot.machine.run("getent", "passwd", "mbot-agent").returncode != 0
