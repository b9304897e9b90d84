"""From installing to purging, on booted machines: each test leaves the next one a robot to use."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mbot_agent.configuration_files import ENROLMENT_FILE, TRUSTED_KEYS_FILE
from mbot_protocol.errors import MbotError
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.models.key_folder import KeyFolder

from ..end_to_end.processes import ROBOT_ID, Process, beats_on, until
from ..reliability.motion import FORWARD, FORWARD_BOARD, driven_since, stopped_s
from ..robot.tiny_models import constant_model
from .booted import CHECKOUT, INSIDE
from .conftest import CONFIGURATION, INSTALL, INSTALL_S, SERVICE, Robot

Record = Callable[[str, object], None]
MEMORY_MB = 110
"""Resident, while it drives with a policy that computes nothing, and with the shipped one."""

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
    record_property("memory MB", round(driven_mb(robot)))
    assert driven_mb(robot) <= MEMORY_MB


def test_the_shipped_policy_has_room(driving: Robot, record_property: Record) -> None:
    with driving.daemon.link() as link:
        RemoteControl(link).stop()
    driving.daemon.push((CHECKOUT / "models/red-cube.onnx").read_bytes())
    assert until(lambda: driving.daemon.status().active_model.name == "red-cube")
    forget_cached_files()
    driving.machine.says("systemctl", "restart", SERVICE)
    assert until(driving.daemon.is_ready, 20), driving.journal()
    driving.daemon.run()
    memory_mb = driven_mb(driving)
    record_property("memory MB", round(memory_mb))
    assert memory_mb <= MEMORY_MB


def driven_mb(robot: Robot) -> float:
    """Its memory after some ten decisions at four frames each: it then is what it stays."""
    driven_s = time.monotonic()
    assert until(lambda: driven_since(robot.board, driven_s) >= 50), robot.journal()
    status = robot.machine.says("cat", f"/proc/{robot.main_pid()}/status")
    resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(resident.split()[1]) / 1024


class Desk:
    """A person's workstation: its own settings, and its commands."""

    def __init__(self, home: Path) -> None:
        self.folder = home / "mbot-agent"
        self._environment = os.environ | {"XDG_CONFIG_HOME": str(home), "LOGNAME": "rosa"}

    def does(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "mbot_workstation.main", *arguments]
        return subprocess.run(
            command, env=self._environment, capture_output=True, text=True, check=False
        )

    def says(self, *arguments: str) -> str:
        done = self.does(*arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


def test_enrolled_it_is_reached_by_certificates_alone(
    driving: Robot, tmp_path: Path, record_property: Record
) -> None:
    robot, machine, desk = driving, driving.machine, Desk(tmp_path)
    KeyFolder(desk.folder / "keys").new("rosa")
    desk.says("enroll", ROBOT_ID, "--host", "127.0.0.1")
    packed = desk.folder / f"fleet/robots/{ROBOT_ID}.tar"
    (machine.root / "root" / packed.name).write_bytes(packed.read_bytes())
    began_s = time.monotonic()
    machine.says("sh", "-c", f"tar -xf /root/{packed.name} -C / && systemctl restart {SERVICE}")
    to_it = ("--robot", ROBOT_ID)
    try:
        assert until(lambda: desk.does("robots", *to_it).returncode == 0, 30), robot.journal()
        record_property("reached again after s", round(time.monotonic() - began_s, 1))
        key = machine.says("stat", "-c", "%U:%G %a", "/etc/mbot-agent/tls/robot.key")
        assert key == "root:mbot-agent 640"
        with pytest.raises(MbotError):
            robot.daemon.status()
        model = tmp_path / "forward.onnx"
        model.write_bytes(constant_model(0.6, 0.6, name="enrolled"))
        desk.says("push-model", str(model), *to_it)
        desk.says("run", *to_it)
        assert robot.board.wait_for(*FORWARD_BOARD, timeout_s=15), robot.journal()
        desk.says("stop", *to_it)
    finally:
        sent = (ENROLMENT_FILE, TRUSTED_KEYS_FILE, "tls/*")
        there = " ".join(f"/etc/mbot-agent/{name}" for name in sent)
        machine.says("sh", "-c", f"rm -f /root/{packed.name} {there}")
        machine.says("systemctl", "restart", SERVICE)
    assert until(robot.lacks_only_a_model, 20), robot.journal()


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
    assert beats_on(driving.daemon.status)
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


def test_uninstalled_what_is_the_persons_stays_for_the_next_time(robot: Robot) -> None:
    machine, before = robot.machine, robot.daemon.status().active_model.sha256
    done = machine.run(str(INSIDE / "deploy/install.sh"), "--uninstall")
    assert done.returncode == 0, done.stdout + done.stderr
    assert robot.shows("LoadState") == "not-found"
    assert machine.run("ls", "/opt/mbot-agent").returncode != 0
    assert machine.run("mbot-agent", "--version").returncode != 0
    assert machine.read(CONFIGURATION) == robot.configuration
    assert machine.run(*INSTALL, timeout_s=INSTALL_S).returncode == 0
    robot.start()
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
