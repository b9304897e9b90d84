"""Which state of the code made something."""

import subprocess
from dataclasses import dataclass
from pathlib import Path

PATIENCE_S = 5.0


@dataclass(frozen=True, slots=True)
class GitState:
    """The code's commit; JSON as it is.

    Attributes:
        commit: 40 hexadecimal digits; empty where the code is installed without its history.
        changed_files: files that differ from the commit, untracked ones included.

    """

    commit: str
    changed_files: tuple[str, ...]


def git_state(folder: Path = Path(__file__).parent) -> GitState:
    """The state of the working tree that holds a folder, this package's if not given."""
    commit = _git(folder, "rev-parse", "HEAD")
    if not commit:
        return GitState("", ())
    status = _git(folder, "status", "--porcelain=v1", "--no-renames")
    return GitState(commit.strip(), tuple(line[3:] for line in status.splitlines()))


def _git(folder: Path, *arguments: str) -> str:
    try:
        run = subprocess.run(
            ["git", "-C", str(folder), *arguments],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return run.stdout if run.returncode == 0 else ""
