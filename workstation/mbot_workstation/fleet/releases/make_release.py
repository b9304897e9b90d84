"""`make dist`: wheel, sdist, and a signed release for each system that robots run.

The same commit, pins, key and compiler of the firmware make the same archives: no date is in them
but the commit's.
"""

import argparse
import getpass
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path

from mbot_protocol.errors import ConfigurationError, MbotError
from mbot_protocol.signing import release_archive, release_manifest
from mbot_protocol.signing.envelope import RELEASE
from mbot_protocol.signing.release_contents import size_on_disk
from mbot_protocol.signing.release_manifest import ReleaseManifest
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.releases.debian_package import make_package
from mbot_workstation.fleet.releases.robot_wheels import TARGETS, Target, fetch_wheels, requirement

CHECKOUT = Path(__file__).parents[4]
UPDATER_MODULES = CHECKOUT / "deploy/updater-modules.txt"
"""Modules of the protocol that the updater uses: those with the standard library only."""

FIRMWARE = CHECKOUT / "out/firmware/mbot-deadman.hex"
"""The board's, as `make firmware` leaves it."""

VENV_BYTES = 4 << 20


def make_release(
    target: Target,
    wheel: Path,
    version: str,
    sequence: int,
    floor: int,
    signers: Sequence[SigningKey],
    folder: Path,
    cache: Path,
    firmware: Path | None,
) -> Path:
    """Write one archive and return where it is.

    Args:
        target: for which system.
        wheel: the daemon's.
        version, sequence, floor: as in `ReleaseManifest`.
        signers: each adds its signature.
        folder: where the archive goes.
        cache: where wheels are kept.
        firmware: the board's, to be flashed from the robot; None: none goes along.

    Raises:
        MbotError: something is missing.

    """
    check_firmware(firmware)
    staging = folder / f"unpacked-{target.name}"
    shutil.rmtree(staging, ignore_errors=True)
    _put_wheels(staging, (*fetch_wheels(target, CHECKOUT, cache).iterdir(), wheel))
    _put_deploy_files(staging, firmware)
    paths = sorted(str(p.relative_to(staging)) for p in staging.rglob("*") if p.is_file())
    files = tuple(release_archive.described(staging, path) for path in paths)
    manifest = ReleaseManifest(
        release_manifest.check_version(version),
        sequence,
        floor,
        target.system,
        target.architecture,
        target.python,
        _installed_bytes(staging / "wheels"),
        files,
    )
    data = release_manifest.encode(manifest)
    release_manifest.decode(data)
    signatures = "".join(key.sign(RELEASE, data).line for key in signers)
    archive = folder / f"mbot-agent-{version}-{target.name}.tar"
    unfinished = archive.with_suffix(".tmp")
    with unfinished.open("wb") as file:
        release_archive.write(file, staging, data, signatures.encode(), files)
    unfinished.rename(archive)
    shutil.rmtree(staging)
    return archive


def build_wheel(folder: Path, *, epoch_s: int, sdist: bool = True) -> Path:
    """The daemon's wheel, and the sdist beside it; both with the commit's date.

    Raises:
        MbotError: the build failed.

    """
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder), "-t", "wheel"]
    environment = os.environ | {"SOURCE_DATE_EPOCH": str(epoch_s)}
    done = subprocess.run(
        command + (["-t", "sdist"] if sdist else []),
        cwd=CHECKOUT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    wheels = sorted(folder.glob("mbot_agent-*.whl"))
    if done.returncode != 0 or not wheels:
        raise MbotError(
            f"the wheel can't be built: {(done.stderr.strip() or '?').splitlines()[-1]}"
        )
    return wheels[-1]


def put_updater(folder: Path) -> None:
    """What root's updater consists of: a folder that Python runs."""
    for name in UPDATER_MODULES.read_text().split():
        module = Path("mbot_protocol", f"{name}.py")
        (folder / module).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(CHECKOUT / "shared/protocol" / module, folder / module)
    (folder / "mbot_update").mkdir()
    for source in sorted((CHECKOUT / "robot/mbot_update").glob("*.py")):
        own = folder if source.name == "__main__.py" else folder / "mbot_update"
        shutil.copyfile(source, own / source.name)


def check_firmware(firmware: Path | None) -> None:
    """Raises ConfigurationError where one is wanted and has not been compiled."""
    if firmware is not None and not firmware.is_file():
        raise ConfigurationError(
            f"no firmware at {firmware}: `make firmware` compiles it; or give --without-firmware"
        )


def _put_wheels(staging: Path, found: Iterable[Path]) -> None:
    wheels = staging / "wheels"
    wheels.mkdir(parents=True)
    for path in found:
        shutil.copyfile(path, wheels / path.name)
    lines = [requirement(path) for path in sorted(wheels.iterdir())]
    (staging / "requirements.txt").write_text("\n".join(lines) + "\n")


def _put_deploy_files(staging: Path, firmware: Path | None) -> None:
    put_updater(staging / "updater")
    for name in ("systemd", "udev", "modules-load.d", "sysusers.d", "first-boot"):
        shutil.copytree(CHECKOUT / "deploy" / name, staging / "deploy" / name)
    for name in ("install.sh", "config.toml"):
        shutil.copyfile(CHECKOUT / "deploy" / name, staging / "deploy" / name)
    if firmware is not None:
        (staging / "firmware").mkdir()
        shutil.copyfile(firmware, staging / "firmware" / firmware.name)


def _installed_bytes(wheels: Path) -> int:
    total = 0
    for path in wheels.iterdir():
        with zipfile.ZipFile(path) as wheel:
            total += sum(size_on_disk(e.filename, e.file_size) for e in wheel.infolist())
    return total + VENV_BYTES


def _git(*arguments: str) -> str:
    done = subprocess.run(
        ["git", *arguments], cwd=CHECKOUT, capture_output=True, text=True, check=False
    )
    return done.stdout.strip()


def _names() -> tuple[str, int]:
    """Version and time of the commit; a changed checkout has no name."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    commit, time_s = _git("rev-parse", "--short=8", "HEAD"), _git("log", "-1", "--format=%ct")
    if not commit:
        raise ConfigurationError("this is not a git checkout: give --version and --sequence")
    if _git("status", "--porcelain", "--untracked-files=no"):
        raise ConfigurationError(
            "the checkout has changes: commit them, or give --version and --sequence"
        )
    return f"{project['version']}+{time_s}.{commit}", int(time_s)


def _ask_passphrase(name: str) -> str:
    return os.environ.get("MBOT_SIGNING_PASSPHRASE") or getpass.getpass(f"Passphrase of {name}: ")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="make dist", description=__doc__)
    parser.add_argument("--version", help="of the release (default: from the commit)")
    parser.add_argument("--sequence", type=int, help="grows from release to release")
    parser.add_argument("--floor", type=int, help="smallest sequence taken afterwards (its own)")
    parser.add_argument("--sign-with", action="append", default=[], metavar="KEY")
    parser.add_argument("--target", action="append", default=[], metavar="SYSTEM-ARCHITECTURE")
    parser.add_argument(
        "--without-firmware", action="store_true", help="none for the board goes along"
    )
    parser.add_argument("--deb", action="store_true", help="a Debian package of each, too")
    parser.add_argument("--output", type=Path, default=CHECKOUT / "out/dist", metavar="DIR")
    return parser


def _main() -> int:
    arguments = _parser().parse_args()
    names = [target.name for target in TARGETS]
    if unknown := set(arguments.target) - set(names):
        raise ConfigurationError(f"unknown target {unknown.pop()}, expected {', '.join(names)}")
    firmware = None if arguments.without_firmware else FIRMWARE
    check_firmware(firmware)
    version, sequence = arguments.version, arguments.sequence
    if version is None or sequence is None:
        version, sequence = _names()
    floor = sequence if arguments.floor is None else arguments.floor
    keys = KeyFolder()
    known = arguments.sign_with or [key.name for key in keys.public_keys()]
    if not arguments.sign_with and len(known) != 1:
        raise ConfigurationError(
            f"which key signs? {', '.join(known) or 'There is none: `workstation keys new`'}; "
            "--sign-with NAME, twice with a spare one (make dist DIST='--sign-with NAME')"
        )
    signers = [keys.load(name, _ask_passphrase) for name in known]
    output: Path = arguments.output
    output.mkdir(parents=True, exist_ok=True)
    for old in output.glob("mbot_agent-*"):
        old.unlink()
    epoch_s = int(_git("log", "-1", "--format=%ct") or 0)
    wheel = build_wheel(output, epoch_s=epoch_s)
    for target in TARGETS:
        if arguments.target and target.name not in arguments.target:
            continue
        cache = CHECKOUT / "out/dist-cache"
        archive = make_release(
            target, wheel, version, sequence, floor, signers, output, cache, firmware
        )
        made = [archive]
        if arguments.deb:
            scripts = CHECKOUT / "deploy/debian"
            made.append(make_package(archive, target, version, output, scripts, epoch_s))
        for path in made:
            print(f"{path} {path.stat().st_size / 1e6:.0f} MB")
    return 0


def main() -> None:
    """Run it; every end is one line."""
    try:
        code = _main()
    except MbotError as error:
        print(f"make dist: {error}", file=sys.stderr)
        code = error.exit_code
    sys.exit(code)


if __name__ == "__main__":
    main()
