"""From `workstation enroll` to a robot that is found by its name, as two people would do it."""

import subprocess
import tarfile
from dataclasses import dataclass
from pathlib import Path

from ..free_port import free_port
from ..ran import WORKSTATION, ran, without_robot
from .processes import ROBOT_ID, Daemon


@dataclass(frozen=True)
class Desk:
    """A user's workstation."""

    folder: Path

    def do(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        who = {"XDG_CONFIG_HOME": str(self.folder), "LOGNAME": self.folder.name}
        return ran(*WORKSTATION, *arguments, env=without_robot() | who)

    def bundle(self, name: str) -> Path:
        return self.folder / "mbot-agent" / "fleet" / f"{name}.tar"


def copy_to_the_robot(bundle: Path, daemon: Daemon) -> None:
    """Unpack as on a robot; only the paths are others here."""
    root = daemon.directory / "root"
    with tarfile.open(bundle) as tar:
        tar.extractall(root, filter="data")
    text = (root / "etc" / "mbot-agent" / "enrolment.toml").read_text()
    (daemon.directory / "enrolment.toml").write_text(text.replace('"/etc/', f'"{root}/etc/'))


def test_two_people_and_a_robot(daemon: Daemon, tmp_path: Path) -> None:
    rosa, max_ = Desk(tmp_path / "rosa"), Desk(tmp_path / "max")
    where = (ROBOT_ID, "--host", "127.0.0.1", "--port", str(free_port()))
    assert rosa.do("enroll", *where, "--person", "max", "--right", "view").returncode == 0
    assert max_.do("enroll", "--join", str(rosa.bundle("persons/max"))).returncode == 0
    copy_to_the_robot(rosa.bundle(f"robots/{ROBOT_ID}"), daemon)
    with daemon.camera(), daemon.start() as process:
        assert daemon.is_up()
        for desk in (rosa, max_):
            seen = desk.do("robots")
            assert (seen.returncode, seen.stderr) == (0, "")
            assert ROBOT_ID in seen.stdout
            stopped = desk.do("stop", "--robot", ROBOT_ID)
            assert stopped.stdout == f"{ROBOT_ID}: stopped\n"
        ran = rosa.do("run", "--robot", ROBOT_ID)
        assert (ran.returncode, ran.stdout) == (6, "")
        assert "not armed: no model yet" in ran.stderr
        ran = rosa.do("run", "--when-ready", "--robot", ROBOT_ID)
        assert (ran.returncode, ran.stderr) == (7, "")
        armed = f"{ROBOT_ID}: armed; it drives when it has a model (no-model: no model yet"
        assert ran.stdout.startswith(armed)
        other = rosa.do("run", "--robot", ROBOT_ID, "--id", "aspen")
        assert (other.returncode, other.stdout) == (2, "")
        assert f"--robot is the enrolled robot {ROBOT_ID}, but --id is aspen" in other.stderr
        servo = str(tmp_path / "servo.onnx")
        assert max_.do("make-servo-policy", servo).returncode == 0
        for arguments, deed in (
            (("run",), "drive"),
            (("models",), "send models to"),
            (("push-model", servo), "send models to"),  # though he has no key either
        ):
            denied = max_.do(*arguments, "--robot", ROBOT_ID)
            assert denied.returncode == 6
            assert f"max has no right to {deed} {ROBOT_ID}" in denied.stderr
            assert denied.stderr.count("\n") == 1
        assert process.is_running()


def test_a_trial_on_this_machine_copies_nothing(daemon: Daemon, tmp_path: Path) -> None:
    rosa = Desk(tmp_path / "rosa")
    said = rosa.do("enroll", "--here", str(daemon.config), "--port", str(free_port()))
    assert (said.returncode, said.stderr) == (0, "")
    assert f"workstation robots --robot {ROBOT_ID}" in said.stdout
    assert "scp" not in said.stdout
    assert (daemon.directory / "tls" / "robot.key").stat().st_mode & 0o077 == 0
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        seen = rosa.do("robots", "--robot", ROBOT_ID)
        assert (seen.returncode, seen.stderr) == (0, "")
        assert ROBOT_ID in seen.stdout


def test_a_daemon_with_wrong_files_says_which(daemon: Daemon, tmp_path: Path) -> None:
    desk = Desk(tmp_path / "rosa")
    assert desk.do("enroll", ROBOT_ID).returncode == 0
    assert desk.do("enroll", "mbot-9").returncode == 0
    copy_to_the_robot(desk.bundle("robots/mbot-9"), daemon)
    with daemon.start() as process:
        assert process.wait() == 2
        assert "is for robot 'mbot-9'" in process.output
    copy_to_the_robot(desk.bundle(f"robots/{ROBOT_ID}"), daemon)
    key = daemon.directory / "root" / "etc" / "mbot-agent" / "tls" / "robot.key"
    key.unlink()
    with daemon.start() as process:
        assert process.wait() == 2
        assert f"network.tls.key: cannot read {key}" in process.output
    assert "Traceback" not in daemon.log.read_text()
