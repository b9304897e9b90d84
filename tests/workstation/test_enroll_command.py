"""`workstation enroll` as a person uses it."""

import json
import os
import subprocess
import tarfile
import tomllib
from pathlib import Path

import pytest

from mbot_agent.configuration import load
from mbot_workstation.fleet.models.key_folder import KeyFolder

from ..ran import WORKSTATION, ran
from .pasted import pasted


class Desk:
    """A user's configuration folder, and the command in it."""

    def __init__(self, folder: Path, user: str) -> None:
        self.fleet = folder / "mbot-agent" / "fleet"
        self._environment = os.environ | {
            "XDG_CONFIG_HOME": str(folder),
            "LOGNAME": user,
            "COLUMNS": "200",
        }

    def enroll(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return ran(*WORKSTATION, "enroll", *arguments, env=self._environment)

    def said(self, *arguments: str) -> str:
        done = self.enroll(*arguments)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path / "rosa", "rosa")


@pytest.mark.slow
def test_from_the_first_robot_to_a_colleague(desk: Desk, tmp_path: Path) -> None:
    first = desk.said("mbot-1")
    assert first.startswith(f"A fleet begins in {desk.fleet}")
    tar = desk.fleet / "robots" / "mbot-1.tar"
    assert f"  scp {tar} USER@mbot-1.local:\n" in first
    assert (
        "  ssh -t USER@mbot-1.local 'sudo tar -xf mbot-1.tar -C / && rm mbot-1.tar && sudo "
        "systemctl restart mbot-agent'\n"
    ) in first
    assert first.endswith("Then: workstation robots --robot mbot-1\n")

    second = desk.said("mbot-1", "--person", "max", "--right", "drive", "--right", "view")
    assert "A fleet begins" not in second
    assert "there: workstation enroll --join max.tar" in second

    listing = desk.said("--list")
    assert "rosa: push, drive; max: view, drive" in listing
    assert "this workstation" in listing

    colleague = Desk(tmp_path / "max", "max")
    joined = colleague.said("--join", str(desk.fleet / "persons" / "max.tar"))
    assert "tls/mbot-1.local:7447" in joined
    assert "max: view, drive" in colleague.said("--list")
    denied = colleague.enroll("mbot-2")
    assert (denied.returncode, denied.stderr.count("\n")) == (6, 1)

    gone = desk.said("--revoke", "max")
    assert "robot mbot-1" in gone
    assert "max is off the roll; until the above is copied, its certificate is let in" in gone
    assert "nothing to do" in desk.said("--renew")


@pytest.mark.slow
def test_whose_models_a_robot_takes_goes_along_and_is_said(desk: Desk, tmp_path: Path) -> None:
    assert "you have none: `workstation keys new` makes one" in desk.said("mbot-1")
    assert keys_in(desk) is None
    keys = KeyFolder(desk.fleet.parent / "keys")
    lines = [keys.new("lab").line, keys.new("rosa").line]
    said = desk.said("mbot-1")
    assert "It takes models signed by lab, rosa from then on: trusted-keys.toml goes" in said
    assert keys_in(desk) == lines
    # What is said for a daemon that ignores the file fits into the configuration that it has.
    assert load(pasted(said, tmp_path / "config.toml")).trust.keys == tuple(lines)

    (keys.path / "lab.pub").write_text("rubbish")
    broken = desk.said("mbot-1")
    assert "Your keys can't be read, so none is added: " in broken
    assert broken.endswith("Then: workstation robots --robot mbot-1\n")
    assert keys_in(desk) == lines, "as before"
    for ending in ("pem", "pub"):
        (keys.path / f"lab.{ending}").unlink()
    assert "and no longer by lab, unless" in desk.said("mbot-1")
    assert keys_in(desk) == lines[1:]
    assert "signed by" not in desk.said("--revoke", "mbot-1")


def keys_in(desk: Desk) -> list[str] | None:
    """Of the robot's file: whose models it shall take."""
    with tarfile.open(desk.fleet / "robots" / "mbot-1.tar") as tar:
        if "etc/mbot-agent/trusted-keys.toml" not in tar.getnames():
            return None
        file = tar.extractfile("etc/mbot-agent/trusted-keys.toml")
        assert file is not None
        return tomllib.loads(file.read().decode())["keys"]


@pytest.mark.slow
def test_a_router_is_told_who_runs_it(desk: Desk) -> None:
    said = desk.said("lab", "--router", "--host", "10.0.0.1")
    assert "'sudo tar -xf lab.tar -C / && rm lab.tar && sudo systemctl restart zenohd'" in said
    assert "tls/10.0.0.1:7447 by lab" in desk.said("mbot-1", "--via", "lab") + desk.said("--list")
    assert "tls/mbot-1.local:7447" in desk.said("mbot-1", "--via", "none") + desk.said("--list")


def test_scripts_get_json(desk: Desk) -> None:
    [robot] = json.loads(desk.said("mbot-1", "--host", "fd00::7", "--json"))
    assert robot == {
        "kind": "robot",
        "name": "mbot-1",
        "file": str(desk.fleet / "robots" / "mbot-1.tar"),
        "host": "fd00::7",
    }
    assert json.loads(desk.said("--list", "--json"))["me"] == "rosa"
    assert "USER@[fd00::7]:" in desk.said("mbot-1")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "expected one of ROBOT, --list"),
        (("mbot-1", "--list"), "expected one of ROBOT, --list"),
        (("--list",), "no fleet in"),
        (("--list", "--person", "max"), "need ROBOT"),
        (("mbot-1", "--right", "view"), "--right is for --person NAME"),
        (("lab", "--router", "--person", "max"), "belong to a robot"),
        (("--here", "no-such.toml"), "can't read no-such.toml"),
        (("--join", "no-such.tar"), "cannot read no-such.tar"),
    ],
)
def test_nonsense_is_told_in_one_line(desk: Desk, arguments: tuple[str, ...], words: str) -> None:
    done = desk.enroll(*arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not desk.fleet.exists()
