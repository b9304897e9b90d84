"""A card's boot partition, as Raspberry Pi Imager leaves it, made ready for its first boot."""

import contextlib
import os
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

from mbot_agent.configuration import load
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli import set_up as command
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases import boot_card
from mbot_workstation.fleet.releases.boot_card import (
    CardContent,
    configured,
    own_configuration,
    prepare,
)
from mbot_workstation.fleet.releases.boot_hook import hook
from mbot_workstation.fleet.releases.robot_wheels import TARGETS

from ..ran import WORKSTATION, ran
from .small_release import small_release

assert command

PLAIN = "console=tty1 root=PARTUUID=abc-02 rootfstype=ext4 rootwait\n"
BY_IMAGER = (
    "console=tty1 root=PARTUUID=abc-02 rootwait systemd.run=/boot/firstrun.sh "
    "systemd.run_success_action=reboot systemd.unit=kernel-command-line.target\n"
)
FIRSTRUN = """#!/bin/bash

set +e

hostname mbot-1
rm -f /boot/firstrun.sh
sed -i 's| systemd.run.*||g' /boot/cmdline.txt
exit 0
"""
USER_DATA = """#cloud-config
hostname: mbot-1
users:
- name: rosa
"""
KEY = SigningKey.ephemeral("rosa").public.line


@pytest.fixture
def release(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return small_release(tmp_path, monkeypatch, TARGETS[0], "0.1")


@pytest.fixture
def boot(tmp_path: Path) -> Path:
    folder = tmp_path / "bootfs"
    folder.mkdir()
    (folder / "cmdline.txt").write_text(BY_IMAGER)
    (folder / "config.txt").write_text("arm_64bit=1\n")
    (folder / "firstrun.sh").write_text(FIRSTRUN)
    return folder


def content(release: Path) -> CardContent:
    text = configured(own_configuration(release), "mbot-1", [KEY])
    return CardContent(release, text, b"a tar file", pi_camera=False)


def test_everything_lies_in_one_folder_and_imagers_script_is_added_to(
    boot: Path, release: Path
) -> None:
    before = {path.name: path.read_bytes() for path in boot.iterdir()}
    for _ in range(2):
        assert prepare(boot, content(release)) == "firstrun.sh"
    assert {path.name for path in boot.iterdir()} == before.keys() | {"mbot"}
    assert (boot / "cmdline.txt").read_bytes() == before["cmdline.txt"]
    added = (boot / "firstrun.sh").read_text()
    ours = [line for line in added.splitlines() if line not in FIRSTRUN.splitlines()]
    assert ours == ['sh "$(dirname "$0")/mbot/first-boot.sh"  # added by workstation setup-card']
    assert added.replace(f"{ours[0]}\n", "") == FIRSTRUN
    assert {path.name for path in (boot / "mbot").iterdir()} == {
        *("release.tar", "config.toml", "enrolment.tar", "install-options"),
        *("first-boot.sh", "set-up.sh", "mbot-set-up.service"),
    }
    assert (boot / "mbot/release.tar").read_bytes() == release.read_bytes()
    assert (boot / "mbot/install-options").read_text() == "--without-picamera2\n"
    assert load(boot / "mbot/config.toml").trust.keys == (KEY,)


ITEM = "- [sh, /boot/firmware/mbot/first-boot.sh, now]  # added by workstation setup-card"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (USER_DATA, f"{USER_DATA}runcmd:\n{ITEM}\n"),
        ("#cloud-config\n", f"#cloud-config\nruncmd:\n{ITEM}\n"),
        (
            f"{USER_DATA}runcmd:\n  # theirs\n  - [ ls ]\nssh: 1\n",
            f"{USER_DATA}runcmd:\n  {ITEM}\n  # theirs\n  - [ ls ]\nssh: 1\n",
        ),
        (
            f"{USER_DATA}runcmd: # now\n- ls",
            f"{USER_DATA}runcmd: # now\n{ITEM}\n- ls\n",
        ),
    ],
)
def test_cloud_inits_user_data_gets_one_more_command(before: str, after: str) -> None:
    assert hook(PLAIN, None, before) == ("user-data", after)
    assert hook(PLAIN, None, after) == ("user-data", after)


def test_without_either_the_kernels_command_line_starts_it_once(boot: Path, release: Path) -> None:
    (boot / "firstrun.sh").unlink()
    (boot / "cmdline.txt").write_text(PLAIN)
    for _ in range(2):
        assert prepare(boot, content(release)) == "cmdline.txt"
    line = (boot / "cmdline.txt").read_text()
    assert line.startswith(PLAIN.strip())
    assert line.count("\n") == 1
    assert line.count("systemd.run=/boot/firmware/mbot/first-boot.sh ") == 1
    units = boot.parent / "units"
    done = subprocess.run(
        ["sh", boot / "mbot/first-boot.sh"],
        env=os.environ | {"MBOT_UNITS": str(units)},
        check=False,
    )
    assert done.returncode == 0
    assert (boot / "cmdline.txt").read_text() == PLAIN
    unit = (units / "multi-user.target.wants/mbot-set-up.service").read_text()
    assert f"ExecStart=/bin/sh {boot}/mbot/set-up.sh" in unit
    assert "@" not in unit


@pytest.mark.parametrize(
    ("cmdline", "firstrun", "user_data", "words"),
    [
        (BY_IMAGER, None, None, "firstrun.sh, which is not there"),
        (BY_IMAGER, "echo hello\n", None, "does not begin with #!"),
        (PLAIN, None, "hostname: x\n", "#cloud-config"),
        (PLAIN, None, "#cloud-config\nruncmd: [ls]\n", "not a list of lines"),
        (f"{PLAIN.strip()} systemd.run=/x", None, None, "already runs /x"),
    ],
)
def test_what_cannot_be_added_to_is_left_alone(
    cmdline: str, firstrun: str | None, user_data: str | None, words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words):
        hook(cmdline, firstrun, user_data)


def test_a_folder_that_is_no_boot_partition_is_refused(
    boot: Path, release: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (boot / "config.txt").unlink()
    for folder in (boot, boot / "nothing", boot / "cmdline.txt"):
        with pytest.raises(ConfigurationError, match="not a boot partition"):
            prepare(folder, content(release))
    (boot / "config.txt").touch()
    monkeypatch.setattr(boot_card, "RESERVE_BYTES", 1 << 60)
    with pytest.raises(ConfigurationError, match="MB free, expected"):
        prepare(boot, content(release))
    assert (boot / "firstrun.sh").read_text() == FIRSTRUN


def test_a_configuration_is_changed_where_it_must_be(release: Path) -> None:
    text = own_configuration(release)
    camera = "http://10.0.0.5/a?b=\\1&c"
    found = tomllib.loads(configured(text, "mbot-2", [KEY], [KEY], camera))
    assert found["robot_id"] == "mbot-2"
    assert found["trust"]["keys"] == found["trust"]["release_keys"] == [KEY]
    assert found["camera"]["source"] == camera
    assert found["control"]["start"] == "idle"
    own = text.replace("\nkeys = []", f'\nkeys = ["{KEY}"]')
    assert tomllib.loads(configured(own, "mbot-2", ["other"]))["trust"]["keys"] == [KEY]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("robot_id", "robot_name"), "no line like"),
        (('start = "idle"', 'start = "running"'), "may not drive at its first boot"),
        (("[board]", "[board"), "not TOML"),
    ],
)
def test_a_configuration_that_cannot_be_used_is_refused(
    release: Path, change: tuple[str, str], words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words):
        configured(own_configuration(release).replace(*change), "mbot-1", [KEY])


@pytest.mark.slow
def test_a_person_makes_a_card(boot: Path, release: Path, tmp_path: Path) -> None:
    environment = os.environ | {"XDG_CONFIG_HOME": str(tmp_path / "rosa"), "LOGNAME": "rosa"}

    def run(*options: str) -> subprocess.CompletedProcess[str]:
        arguments = (str(boot), "--robot", "mbot-1", "--release", str(release), *options)
        return ran(*WORKSTATION, "setup-card", *arguments, env=environment)

    without = run()
    assert without.returncode == 2
    assert "workstation keys new" in without.stderr
    assert not (boot / "mbot").exists()
    line = KeyFolder(tmp_path / "rosa/mbot-agent/keys").new("rosa").line
    done = run("--camera", "/dev/video0", "--release-key", "rosa")
    assert (done.returncode, done.stderr) == (0, "")
    assert "firstrun.sh on the card starts it" in done.stdout
    assert "workstation robots --robot mbot-1" in done.stdout
    made = load(boot / "mbot/config.toml")
    assert (made.robot_id, made.trust.keys) == ("mbot-1", (line,))
    assert made.trust.release_keys == (line,)
    with contextlib.closing(tarfile.open(boot / "mbot/enrolment.tar")) as tar:
        assert "etc/mbot-agent/tls/robot.key" in tar.getnames()
    assert run("--release-key", "max").returncode == 2


def test_shellcheck_has_nothing_to_say() -> None:
    scripts = sorted((Path(__file__).parents[2] / "deploy/first-boot").glob("*.sh"))
    shellcheck = Path(sys.executable).with_name("shellcheck")
    result = ran(shellcheck, *scripts)
    assert scripts
    assert result.returncode == 0, result.stdout
