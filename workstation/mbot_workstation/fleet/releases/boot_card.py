"""Puts a release, a configuration and certificates onto a card's boot partition.

The card has been written by Raspberry Pi Imager and not been started yet. Everything of ours lies
in one folder; of the files that are there one is added to (`boot_hook.py`), at the very end.
"""

import json
import os
import re
import shutil
import tarfile
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import text_if_any
from mbot_protocol.wire.keys import check_robot_id
from mbot_workstation.fleet.releases.boot_hook import FOLDER, hook

RESERVE_BYTES = 8 << 20
PI_CAMERA = "picamera2"


@dataclass(frozen=True, slots=True)
class CardContent:
    """What a robot gets.

    Attributes:
        release: its archive.
        configuration: config.toml.
        enrolment: a tar file of its certificates; empty: none, it is reached by SSH.
        pi_camera: whether its camera is at the Pi's own connector.

    """

    release: Path
    configuration: str
    enrolment: bytes
    pi_camera: bool


def configured(
    text: str,
    robot_id: str,
    keys: Sequence[str],
    release_keys: Sequence[str] = (),
    camera: str = "",
) -> str:
    """A configuration for this robot, made of another one's text.

    Args:
        text: such as the release's own config.toml; keys in it stay.
        robot_id: its name.
        keys: whose models it takes, if the text names none.
        release_keys: whose releases it takes, if the text names none.
        camera: `source` of [camera]; empty: as it is.

    Raises:
        ConfigurationError: the text has no place for one of them, or lets the robot drive at boot.

    """
    check_robot_id(robot_id)
    changes = [(r"robot_id = .*", f"robot_id = {json.dumps(robot_id)}")]
    if camera:
        changes.append((r"source = .*", f"source = {json.dumps(camera)}"))
    for name, lines in (("keys", keys), ("release_keys", release_keys)):
        if lines and re.search(rf"^{name} = \[\]", text, re.MULTILINE):
            changes.append((rf"{name} = \[\]", f"{name} = {json.dumps(list(lines))}"))
    for pattern, line in changes:
        text, count = re.subn(
            f"^{pattern}$", line.replace("\\", r"\\"), text, count=1, flags=re.MULTILINE
        )
        if count == 0:
            raise ConfigurationError(f"the configuration has no line like {line!r} to change")
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"the configuration is not TOML: {error}") from None
    if found.get("control", {}).get("start", "idle") != "idle":
        raise ConfigurationError('start = "running": a robot may not drive at its first boot')
    return text


def own_configuration(release: Path) -> str:
    """The config.toml that a release brings.

    Raises:
        ConfigurationError: it has none.

    """
    return _member(release, "deploy/config.toml").decode()


def check_boot_partition(boot: Path) -> str:
    """The kernel's command line on a card's first partition.

    Raises:
        ConfigurationError: this folder is none.

    """
    cmdline = text_if_any(boot / "cmdline.txt")
    if cmdline is None or not (boot / "config.txt").is_file() or "root=" not in cmdline:
        raise ConfigurationError(
            f"{boot} is not a boot partition of Raspberry Pi OS (cmdline.txt with root=, "
            "config.txt): where is the card's first partition mounted?"
        )
    return cmdline


def prepare(boot: Path, content: CardContent) -> str:
    """Write it all; returns which of Imager's files calls it.

    Raises:
        ConfigurationError: this is not a boot partition, is too small, or can't be written.

    """
    cmdline = check_boot_partition(boot)
    added = hook(cmdline, text_if_any(boot / "firstrun.sh"), text_if_any(boot / "user-data"))
    folder = boot / FOLDER
    try:
        shutil.rmtree(folder, ignore_errors=True)
        needed = content.release.stat().st_size + RESERVE_BYTES
        if (free := shutil.disk_usage(boot).free) < needed:
            raise ConfigurationError(
                f"{boot} has {free / 1e6:.0f} MB free, expected {needed / 1e6:.0f} MB"
            )
        _fill(folder, content)
        os.sync()
        atomic_file.replace(boot / added.name, added.text.encode())
        os.sync()
    except OSError as error:
        raise ConfigurationError(f"cannot write to {boot}: {error.strerror}") from None
    return added.name


def _fill(folder: Path, content: CardContent) -> None:
    folder.mkdir()
    for name in ("first-boot.sh", "set-up.sh", "mbot-set-up.service"):
        (folder / name).write_bytes(_member(content.release, f"deploy/first-boot/{name}"))
        (folder / name).chmod(0o755)
    (folder / "config.toml").write_text(content.configuration)
    options = "" if content.pi_camera else "--without-picamera2"
    (folder / "install-options").write_text(f"{options}\n")
    if content.enrolment:
        (folder / "enrolment.tar").write_bytes(content.enrolment)
    shutil.copyfile(content.release, folder / "release.tar")


def _member(release: Path, name: str) -> bytes:
    with tarfile.open(release, "r:") as tar:  # one that is packed could be of any size
        try:
            file = tar.extractfile(name)
        except KeyError:
            file = None
        if file is None:
            raise ConfigurationError(
                f"{release} has no {name}: make it again with `make dist`, for first boots"
            )
        return file.read()
