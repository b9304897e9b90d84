"""A release as a Debian package, for people who want apt.

It holds the signed archive as it is, and its scripts call the same installer, so there is one way
onto a robot. The scripts download nothing.
"""

import os
import shutil
import subprocess
import tarfile
from pathlib import Path

from mbot_protocol.errors import MbotError
from mbot_workstation.fleet.releases.robot_wheels import Target

HOME = "usr/lib/mbot-agent"
SCRIPTS = ("postinst", "prerm", "postrm")

_DEBIAN_NUMBERS = {"bookworm": 12, "trixie": 13}

_CONTROL = """Package: mbot-agent
Version: {version}
Architecture: {architecture}
Maintainer: mbot-agent contributors <mbot-agent@localhost>
Installed-Size: {installed_kb}
Depends: python3 (>= {python}~), python3 (<< {next_python}~), systemd, udev
Suggests: python3-picamera2
Section: misc
Priority: optional
Description: Drives a Makeblock mBot by a camera policy
 The daemon, its units and its updater. It is installed into /opt/mbot-agent/releases and started
 by a person: systemctl start mbot-agent. A camera at the Pi's own connector needs
 python3-picamera2 as well.
"""


def make_package(
    archive: Path, target: Target, version: str, folder: Path, scripts: Path, epoch_s: int
) -> Path:
    """Write one package and return where it is; the same archive makes the same package.

    Args:
        archive: the release.
        target: the system it is for.
        version: the release's.
        folder: where the package goes.
        scripts: deploy/debian of this checkout; install.sh lies above it.
        epoch_s: the date of everything in it.

    Raises:
        MbotError: this machine can't make packages.

    """
    package = folder / f"mbot-agent_{_version(version, target)}_{target.architecture}.deb"
    staging = folder / f"package-{target.name}"
    shutil.rmtree(staging, ignore_errors=True)
    home = staging / HOME
    home.mkdir(parents=True)
    shutil.copyfile(archive, home / "release.tar")
    with tarfile.open(archive) as tar:
        tar.extractall(
            home,
            [m for m in tar.getmembers() if m.name.startswith(("deploy/", "updater/"))],
            filter="data",
        )
    (home / "deploy/install.sh").chmod(0o755)
    control = staging / "DEBIAN"
    control.mkdir()
    (control / "control").write_text(_control(target, version, home))
    for name in SCRIPTS:
        text = (scripts / name).read_text()
        if name == "postrm":
            text += (scripts.parent / "install.sh").read_text()
        (control / name).write_text(text)
        (control / name).chmod(0o755)
    _build(staging, package, epoch_s)
    shutil.rmtree(staging)
    return package


def _version(version: str, target: Target) -> str:
    """One release is older for Bookworm than for Trixie, so that an upgrade of the system takes it
    along. A package's version has no '_'."""
    return f"{version.replace('_', '.')}~deb{_DEBIAN_NUMBERS[target.system]}"


def _control(target: Target, version: str, home: Path) -> str:
    major, minor = target.python.split(".")
    size_kb = sum(p.stat().st_size for p in home.rglob("*") if p.is_file()) // 1024
    return _CONTROL.format(
        version=_version(version, target),
        architecture=target.architecture,
        installed_kb=size_kb,
        python=target.python,
        next_python=f"{major}.{int(minor) + 1}",
    )


def _build(staging: Path, package: Path, epoch_s: int) -> None:
    # Wheels are compressed already.
    command = ["dpkg-deb", "--build", "--root-owner-group", "-Znone", str(staging), str(package)]
    environment = os.environ | {"SOURCE_DATE_EPOCH": str(epoch_s)}
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise MbotError("packages are made by dpkg-deb, which is not here: use Debian") from None
    if done.returncode != 0:
        raise MbotError(f"dpkg-deb failed: {(done.stderr.strip() or '?').splitlines()[-1]}")
