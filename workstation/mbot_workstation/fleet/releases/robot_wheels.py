"""The wheels that a robot's system needs, pinned by version and digest, and kept in a folder.

`deploy/requirements/SYSTEM-ARCHITECTURE.txt` pins them. Where there is none for a system it is
resolved once, from pyproject.toml and the system's constraints, and written.
"""

import hashlib
import re
import subprocess
import sys
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import MbotError, UnreachableError
from mbot_protocol.signing.release_contents import is_needed

_GLIBC_MINORS = {"bookworm": 36, "trixie": 41}
_PYTHONS = {"bookworm": "3.11", "trixie": "3.13"}
_PROCESSORS = {"arm64": "aarch64", "amd64": "x86_64"}


@dataclass(frozen=True, slots=True)
class Target:
    """A system that robots run."""

    system: str
    architecture: str

    @property
    def name(self) -> str:
        """For files: "bookworm-arm64"."""
        return f"{self.system}-{self.architecture}"

    @property
    def python(self) -> str:
        """The system's: "3.11"."""
        return _PYTHONS[self.system]

    @property
    def pip_options(self) -> list[str]:
        """What makes pip look for this system's wheels, and for wheels only."""
        processor = _PROCESSORS[self.architecture]
        platforms = [f"manylinux_2_{n}_{processor}" for n in range(5, _GLIBC_MINORS[self.system])]
        platforms += [f"manylinux2014_{processor}", f"manylinux2010_{processor}"]
        options = ["--only-binary=:all:", "--python-version", self.python]
        options += ["--implementation", "cp", "--abi", f"cp{self.python.replace('.', '')}"]
        options += ["--abi", "abi3", "--abi", "none"]
        return options + [word for name in platforms for word in ("--platform", name)]


TARGETS = tuple(Target(system, arch) for system in _PYTHONS for arch in _PROCESSORS)


def fetch_wheels(target: Target, checkout: Path, cache: Path) -> Path:
    """The folder with exactly the wheels that are pinned for a system.

    Raises:
        UnreachableError: pip can't get one of them.

    """
    pins = checkout / "deploy/requirements" / f"{target.name}.txt"
    folder = cache / target.name
    folder.mkdir(parents=True, exist_ok=True)
    if not pins.is_file():
        _download(target, folder, _wanted(target, checkout, cache))
        for wheel in folder.glob("*.whl"):
            if not holds_needed_files(wheel):
                wheel.unlink()
        pins.parent.mkdir(parents=True, exist_ok=True)
        pins.write_text(
            _pins(folder, f"# Wheels of a robot: {target.name}. `make pins` writes it.\n")
        )
    wanted = set(re.findall(r"--hash=sha256:([0-9a-f]{64})", pins.read_text()))
    if wanted != _drop_others(folder, wanted):
        _download(target, folder, ["--no-deps", "--require-hashes", "-r", str(pins)])
        if wanted != _drop_others(folder, wanted):
            raise MbotError(f"{folder} lacks a wheel that {pins} names: remove the folder")
    return folder


def requirement(wheel: Path) -> str:
    """A line for pip that takes this very file."""
    name, version = wheel.name.split("-")[:2]
    return f"{name.replace('_', '-').lower()}=={version} --hash=sha256:{digest(wheel)}"


def holds_needed_files(wheel: Path) -> bool:
    """Whether a robot keeps anything of a wheel; what a library wants, it may do without."""
    with zipfile.ZipFile(wheel) as archive:
        return any(is_needed(name) for name in archive.namelist())


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _wanted(target: Target, checkout: Path, cache: Path) -> list[str]:
    """Words for pip: what pyproject.toml asks for, at the versions that the tests run with where
    the system has no word in it."""
    project = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]
    words = [*project["dependencies"], *project["optional-dependencies"]["robot"]]
    own = _lines(checkout / f"deploy/constraints-{target.system}.txt")
    bound = {_name(line) for line in own}
    tested = [line for line in _lines(checkout / "constraints.txt") if _name(line) not in bound]
    constraints = cache / f"{target.name}.constraints"
    constraints.write_text("\n".join([*own, *tested]) + "\n")
    return ["-c", str(constraints), *words]


def _lines(path: Path) -> list[str]:
    text = path.read_text() if path.is_file() else ""
    return [line for line in text.splitlines() if line and not line.startswith("#")]


def _name(line: str) -> str:
    return re.split("[=<>]", line)[0].lower()


def _pins(folder: Path, head: str) -> str:
    return head + "".join(f"{requirement(wheel)}\n" for wheel in sorted(folder.glob("*.whl")))


def _drop_others(folder: Path, wanted: set[str]) -> set[str]:
    """The digests that are there, after all that nobody wants is gone."""
    found: set[str] = set()
    for wheel in folder.glob("*"):
        if (own := digest(wheel)) in wanted:
            found.add(own)
        else:
            wheel.unlink()
    return found


def _download(target: Target, folder: Path, wanted: list[str]) -> None:
    command = [sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check"]
    command += ["--dest", str(folder), *target.pip_options, *wanted]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or ["pip failed"]
        raise UnreachableError(f"no wheels for {target.name}: {lines[-1]}")
