"""The Debian package on a booted machine: installed, upgraded, removed, purged, by apt."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases.debian_package import make_package

from ..end_to_end.processes import until
from ..reliability.motion import FORWARD
from .booted import CHECKOUT, INSIDE, Machine
from .conftest import CONFIGURATION, Robot
from .release_variants import NOT_READY, Releases
from .test_updates import FOLDER, running

KEY = SigningKey.ephemeral("releases")
FIRST, SECOND, MUTE = "0.1.0+deb1", "0.1.0+deb2", "0.1.0+deb3"
OFFLINE = "Acquire::http::Proxy=http://127.0.0.1:1"


def package(releases: Releases, version: str, sequence: int, code: str = "") -> str:
    """A package's path, there."""
    archive = releases.make(version, sequence, KEY, code)
    made = make_package(archive, releases.target, version, FOLDER, CHECKOUT / "deploy/debian", 1)
    return str(INSIDE / made.relative_to(CHECKOUT))


def apt(package: str) -> tuple[str, ...]:
    """Without a network: neither apt nor a script of the package may want one."""
    words = "env DEBIAN_FRONTEND=noninteractive no_proxy= unshare --net"
    return (*words.split(), "apt-get", "-o", OFFLINE, "-y", "install", package)


@pytest.fixture(scope="module", params=["bookworm", "trixie"])
def releases(request: pytest.FixtureRequest) -> Releases:
    return Releases(FOLDER, request.param)


@pytest.fixture(scope="module")
def robot(releases: Releases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    directory = tmp_path_factory.mktemp("package")
    first = package(releases, FIRST, 1)
    with Machine(releases.system, directory) as machine:
        venv = ("python3-venv", f"python{releases.target.python}-venv")
        machine.says("dpkg", "--purge", "--force-depends", *venv)
        made = Robot(machine, directory, apt(first))
        assert made.installed.returncode == 0, made.installed.stdout + made.installed.stderr
        with made.board, made.daemon.camera():
            yield made


def test_it_installs_and_starts_nothing(
    robot: Robot, record_property: Callable[[str, object], None]
) -> None:
    record_property("installed in s", round(robot.install_s, 1))
    assert robot.state() == "inactive"
    assert robot.shows("UnitFileState") == "enabled"
    robot.configure()
    robot.start()
    robot.daemon.push(FORWARD)
    assert until(robot.daemon.is_ready)
    assert running(robot) == FIRST


def test_an_upgrade_goes_by_the_health_gate(robot: Robot, releases: Releases) -> None:
    done = robot.machine.run(*apt(package(releases, SECOND, 2)), timeout_s=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert running(robot) == SECOND
    assert robot.machine.read(CONFIGURATION) == robot.configuration
    failed = robot.machine.run(*apt(package(releases, MUTE, 3, NOT_READY)), timeout_s=120)
    assert failed.returncode != 0
    assert f"{SECOND} runs again" in failed.stdout + failed.stderr
    assert until(robot.daemon.is_ready, 30)
    assert running(robot) == SECOND
    done = robot.machine.run("dpkg", "--configure", "-a")
    assert done.returncode != 0  # tried again, and refused again


def test_removed_it_stops_and_keeps_what_is_the_persons(robot: Robot) -> None:
    done = robot.machine.run("apt-get", "-y", "remove", "mbot-agent")
    assert done.returncode == 0, done.stdout + done.stderr
    assert robot.state() == "inactive"
    assert robot.machine.run("ls", "/opt/mbot-agent").returncode != 0
    assert robot.machine.run("ls", "/usr/lib/mbot-agent").returncode != 0
    assert robot.machine.read(CONFIGURATION) == robot.configuration


def test_after_a_purge_nothing_is_left(robot: Robot) -> None:
    robot.edit_units()
    done = robot.machine.run("apt-get", "-y", "purge", "mbot-agent")
    assert done.returncode == 0, done.stdout + done.stderr
    left = robot.machine.files() - robot.files_before
    backups = {"/etc/passwd-", "/etc/group-", "/etc/shadow-", "/etc/gshadow-"}  # userdel's own
    dpkg = {path for path in left if Path(path).parent == Path("/var/lib/dpkg")}
    apts = {path for path in left if path.startswith("/var/lib/apt/")}
    assert left - backups - dpkg - apts == set()
    assert robot.machine.run("getent", "passwd", "mbot-agent").returncode != 0
