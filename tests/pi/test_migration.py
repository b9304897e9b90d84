"""A robot installed before there were releases gets one, on a booted machine."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_workstation.fleet.models.signing_key import SigningKey

from ..end_to_end.processes import until
from ..reliability.motion import FORWARD
from .booted import CHECKOUT, INSIDE, Machine
from .conftest import CONFIGURATION, SERVICE, Robot
from .release_variants import CACHE, NOT_READY, Releases
from .test_updates import FOLDER, from_archive, running

KEY = SigningKey.ephemeral("releases")
NEW, MUTE = "0.1.0+new", "0.1.0+mute-at-first"
UNIT = "/etc/systemd/system/mbot-agent.service"

AS_IT_WAS = f"""set -e
install -D -m 0644 {INSIDE}/deploy/sysusers.d/mbot-agent.conf /etc/sysusers.d/mbot-agent.conf
systemd-sysusers
install -d -m 0700 -o mbot-agent -g mbot-agent /var/lib/mbot-agent
python3 -m venv --system-site-packages /opt/mbot-agent/venv
/opt/mbot-agent/venv/bin/python -m pip install -q --no-index --no-deps \\
    {{wheels}}/*.whl {{own}}/mbot_agent-*.whl
ln -s /opt/mbot-agent/venv/bin/mbot-agent /usr/local/bin/mbot-agent
install -D -m 0640 {INSIDE}/deploy/config.toml {CONFIGURATION}
chown root:mbot-agent {CONFIGURATION}
sed -e s,/current/,/, -e /^OnFailure/d {INSIDE}/deploy/systemd/mbot-agent.service > {UNIT}
systemctl daemon-reload
systemctl enable {SERVICE}
"""
"""What deploy/install.sh did then."""


@pytest.fixture(scope="module")
def releases() -> Releases:
    return Releases(FOLDER, "bookworm")


@pytest.fixture(scope="module")
def robot(releases: Releases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """It runs, with a model."""
    assert releases
    directory = tmp_path_factory.mktemp("migration")
    wheels, own = (INSIDE / p.relative_to(CHECKOUT) for p in (CACHE / "bookworm-amd64", FOLDER))
    script = AS_IT_WAS.format(wheels=wheels, own=own)
    with Machine("bookworm", directory) as machine:
        made = Robot(machine, directory, ("sh", "-c", script))
        assert made.installed.returncode == 0, made.installed.stdout + made.installed.stderr
        with made.board, made.daemon.camera():
            made.configure()
            made.start()
            made.daemon.push(FORWARD)
            assert until(made.daemon.is_ready)
            yield made


def installed(robot: Robot, archive: Path) -> tuple[int, str]:
    robot.machine.says("rm", "-rf", "/tmp/release")
    done = robot.machine.run(*from_archive(INSIDE / archive.relative_to(CHECKOUT)), timeout_s=300)
    return done.returncode, done.stdout + done.stderr


def command_line(robot: Robot) -> str:
    return robot.machine.says("cat", f"/proc/{robot.main_pid()}/cmdline").replace("\0", " ")


def test_a_release_that_does_not_start_leaves_the_old_installation_running(
    robot: Robot, releases: Releases
) -> None:
    model = robot.daemon.status().active_model.sha256
    code, words = installed(robot, releases.make(MUTE, 1, KEY, NOT_READY))
    assert code == 1, words
    assert "Taking over the installation in /opt/mbot-agent/venv" in words
    assert "0-before-releases runs again" in words
    assert "/opt/mbot-agent/venv/bin/python" in command_line(robot)
    assert until(robot.daemon.is_ready, 30)
    assert robot.daemon.status().active_model.sha256 == model
    assert not robot.board.moved


def test_the_next_one_takes_its_place_and_keeps_everything(
    robot: Robot, releases: Releases
) -> None:
    model = robot.daemon.status().active_model.sha256
    code, words = installed(robot, releases.make(NEW, 2, KEY))
    assert code == 0, words
    assert running(robot) == NEW
    assert until(robot.daemon.is_ready, 30)
    assert robot.daemon.status().active_model.sha256 == model
    assert robot.machine.read(CONFIGURATION) == robot.configuration
    assert robot.machine.run("ls", "/opt/mbot-agent/venv").returncode != 0
    assert robot.machine.says("ls", "/opt/mbot-agent/releases") == NEW
    assert not robot.board.moved
    robot.machine.says("systemctl", "is-enabled", SERVICE)


def test_after_a_purge_nothing_is_left(robot: Robot) -> None:
    script = str(INSIDE / "deploy/install.sh")
    done = robot.machine.run(script, "--uninstall", "--purge")
    assert done.returncode == 0, done.stdout + done.stderr
    backups = {"/etc/passwd-", "/etc/group-", "/etc/shadow-", "/etc/gshadow-"}  # userdel's own
    assert robot.machine.files() - robot.files_before - backups == set()
