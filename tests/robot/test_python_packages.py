"""Wheels become a folder of packages; what a robot does not need is not in it."""

import os
import subprocess
import venv
from pathlib import Path

import pytest

from mbot_protocol.errors import RefusedError
from mbot_update.python_packages import leave_out, packages_of, unpack_wheels

from .release_bench import wheel

UNNEEDED = {
    "pip/__init__.py",
    "lz4/frame.py",
    "numpy/core/tests/test_x.py",
    "numpy/core/tests/__pycache__/test_x.cpython-311.pyc",
    "cv2/data/haarcascade_eye.xml",
}
NEEDED = {
    "numpy/core/x.py",
    "numpy/core/__pycache__/x.cpython-311.pyc",
    "numpy/testing/x.py",
    "cv2/data/__init__.py",
    "tests.py",
    "pipes/__init__.py",
}


@pytest.fixture
def environment(tmp_path: Path) -> Path:
    made = tmp_path / "venv"
    venv.create(made, symlinks=True)
    return made


@pytest.fixture
def wheels(tmp_path: Path) -> Path:
    folder = tmp_path / "wheels"
    folder.mkdir()
    return folder


def test_the_command_runs_what_the_wheels_hold(environment: Path, wheels: Path) -> None:
    daemon = wheel(mbot_agent__main=b"import other\ndef main():\n    return other.CODE\n")
    (wheels / "a.whl").write_bytes(daemon)
    (wheels / "b.whl").write_bytes(wheel(other=b"CODE = 7\n", lz4__frame=b""))
    unpack_wheels(wheels, environment)
    command = environment / "bin/mbot-agent"
    assert subprocess.run([command], env={}, check=False).returncode == 7
    assert not (packages_of(environment) / "lz4").exists()


@pytest.mark.parametrize("name", ["..__evil", "__evil", "a.data__scripts__x"])
def test_a_wheel_that_leads_elsewhere_is_refused(
    environment: Path, wheels: Path, name: str
) -> None:
    (wheels / "a.whl").write_bytes(wheel(**{name: b"x"}))
    with pytest.raises(RefusedError, match="a wheel holds"):
        unpack_wheels(wheels, environment)
    assert not list(environment.parent.rglob("evil*"))


@pytest.mark.parametrize("data", [b"", b"no wheel", wheel(a=b"x" * 1000)[:500]])
def test_what_is_no_wheel_is_refused(environment: Path, wheels: Path, data: bytes) -> None:
    (wheels / "a.whl").write_bytes(data)
    with pytest.raises(RefusedError, match="is not a wheel"):
        unpack_wheels(wheels, environment)


def test_of_what_pip_has_installed_only_the_needed_stays(environment: Path) -> None:
    site = packages_of(environment)
    for name in UNNEEDED | NEEDED:
        (site / name).parent.mkdir(parents=True, exist_ok=True)
        (site / name).touch()
    (environment / "bin/pip3").touch()
    leave_out(environment)
    assert {str(p.relative_to(site)) for p in site.rglob("*") if p.is_file()} == NEEDED
    assert not [p for p in site.rglob("*") if p.is_dir() and not os.listdir(p)]  # noqa: PTH208
    assert not (environment / "bin/pip3").exists()
    assert subprocess.run([environment / "bin/python", "-c", ""], check=False).returncode == 0


def test_what_is_no_environment_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="not a virtual environment"):
        leave_out(tmp_path)
