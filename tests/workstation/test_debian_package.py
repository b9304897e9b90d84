"""A release as a Debian package, and the scripts in it."""

import subprocess
import sys
from pathlib import Path

import pytest

from mbot_protocol.errors import MbotError
from mbot_workstation.fleet.releases import debian_package
from mbot_workstation.fleet.releases.debian_package import make_package
from mbot_workstation.fleet.releases.robot_wheels import TARGETS

from .small_release import small_release

CHECKOUT = Path(__file__).parents[2]
SCRIPTS = CHECKOUT / "deploy/debian"
TARGET = next(target for target in TARGETS if target.name == "trixie-arm64")


@pytest.fixture
def archive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return small_release(tmp_path, monkeypatch, TARGET, "0.1+7_a")


def package(archive: Path, folder: Path) -> Path:
    folder.mkdir()
    return make_package(archive, TARGET, "0.1+7_a", folder, SCRIPTS, 1_700_000_000)


def said(*command: str | Path) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_it_holds_the_release_and_the_installer(archive: Path, tmp_path: Path) -> None:
    made = package(archive, tmp_path / "out")
    assert made.name == "mbot-agent_0.1+7.a~deb13_arm64.deb"
    said("dpkg-deb", "-x", made, tmp_path / "x")
    home = tmp_path / "x/usr/lib/mbot-agent"
    assert (home / "release.tar").read_bytes() == archive.read_bytes()
    assert (home / "deploy/install.sh").stat().st_mode & 0o111
    assert (home / "updater/__main__.py").exists()
    assert not (home / "wheels").exists()
    control = said("dpkg-deb", "-f", made)
    assert "Depends: python3 (>= 3.13~), python3 (<< 3.14~), systemd, udev" in control
    assert list((tmp_path / "out").iterdir()) == [made]


def test_the_same_release_makes_the_same_package(archive: Path, tmp_path: Path) -> None:
    first, second = (package(archive, tmp_path / name).read_bytes() for name in ("a", "b"))
    assert first == second


def test_a_newer_system_has_the_newer_package() -> None:
    versions = [debian_package._version("0.1+7", t) for t in TARGETS[::2]]  # pyright: ignore[reportPrivateUsage]
    said("dpkg", "--compare-versions", versions[0], "lt", versions[1])


def test_its_scripts_download_nothing_and_shellcheck_is_content(
    archive: Path, tmp_path: Path
) -> None:
    said("dpkg-deb", "-e", package(archive, tmp_path / "out"), tmp_path / "control")
    for name in debian_package.SCRIPTS:
        script = tmp_path / "control" / name
        said(Path(sys.executable).with_name("shellcheck"), script)
        assert script.stat().st_mode & 0o111
    assert "apt" not in (tmp_path / "control/postinst").read_text().replace("of apt", "")


@pytest.mark.parametrize("word", ["upgrade", "failed-upgrade", "abort-install", "remove"])
def test_only_a_purge_purges(archive: Path, tmp_path: Path, word: str) -> None:
    said("dpkg-deb", "-e", package(archive, tmp_path / "out"), tmp_path / "control")
    root = tmp_path / "root"
    (root / "opt/mbot-agent").mkdir(parents=True)
    environment = {"MBOT_INSTALL_ROOT": str(root), "PATH": "/nothing"}
    done = subprocess.run(
        ["/bin/sh", tmp_path / "control/postrm", word], env=environment, check=False
    )
    assert done.returncode == 0
    assert (root / "opt/mbot-agent").exists()


def test_without_dpkg_it_says_so(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MbotError, match="dpkg-deb"):
        package(archive, tmp_path / "out")
