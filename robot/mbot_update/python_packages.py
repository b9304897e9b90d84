"""A release's Python packages: wheels unpacked without pip, and what is not needed left out.

pip would write twice as much to the card, itself included, and take minutes for it on a small Pi.
What is unpacked here has been verified, wheel by wheel, and is all that a release consists of.
"""

import shutil
import zipfile
from pathlib import Path, PurePosixPath

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.release_contents import is_needed

COMMAND = "mbot-agent"

_COMMAND_TEXT = """#!{python}
import sys

from mbot_agent.main import main

sys.exit(main())
"""


def unpack_wheels(wheels: Path, venv: Path) -> None:
    """Put the packages of all wheels into a virtual environment, and the daemon's command.

    Raises:
        RefusedError: one is not a wheel, or not laid out as ours are.

    """
    site = packages_of(venv)
    for wheel in sorted(wheels.iterdir()):
        try:
            with zipfile.ZipFile(wheel) as archive:
                for entry in archive.infolist():
                    _unpack(archive, entry, site)
        except (zipfile.BadZipFile, NotImplementedError, EOFError) as error:
            raise RefusedError(f"{wheel.name} is not a wheel: {error}") from None
    command = venv / "bin" / COMMAND
    command.write_text(_COMMAND_TEXT.format(python=venv / "bin/python"))
    command.chmod(0o755)


def leave_out(venv: Path) -> None:
    """Delete what is not needed of what pip has installed, and pip."""
    site = packages_of(venv)
    for path in sorted(site.rglob("*"), reverse=True):
        if path.is_dir() and not path.is_symlink():
            if not is_needed(f"{path.relative_to(site).as_posix()}/."):
                shutil.rmtree(path)
        elif not is_needed(_source(path.relative_to(site))):
            path.unlink()
    for path in (venv / "bin").glob("pip*"):
        path.unlink()


def packages_of(venv: Path) -> Path:
    """Where a virtual environment keeps its packages.

    Raises:
        RefusedError: it has no such folder.

    """
    found = sorted(venv.glob("lib/python3*/site-packages"))
    if len(found) != 1:
        raise RefusedError(f"{venv} is not a virtual environment")
    return found[0]


def _unpack(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, site: Path) -> None:
    path = PurePosixPath(entry.filename)
    if path.is_absolute() or ".." in path.parts:
        raise RefusedError(f"a wheel holds {entry.filename!r}, which leads out of its folder")
    if path.parts[0].endswith(".data"):
        raise RefusedError(f"a wheel holds {entry.filename!r}, which belongs elsewhere")
    if entry.is_dir() or not is_needed(entry.filename):
        return
    target = site / path
    target.parent.mkdir(parents=True, exist_ok=True)
    with archive.open(entry) as source, target.open("wb") as sink:
        shutil.copyfileobj(source, sink, 1 << 20)


def _source(path: Path) -> str:
    """The name of what a file was compiled of, or its own."""
    if path.parent.name != "__pycache__":
        return path.as_posix()
    return (path.parent.parent / f"{path.name.partition('.')[0]}.py").as_posix()
