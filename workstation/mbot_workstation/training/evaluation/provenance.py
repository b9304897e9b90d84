"""Of which policy, and made with which code, a page of results is."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from mbot_workstation.training.drivers.contestants import BUILT_IN, title
from mbot_workstation.training.learning.git_state import git_state


def provenance(contestants: Sequence[str]) -> str:
    """One line for the page: "Policy: red-cube `0123456789ab`; commit `0123456`."

    Args:
        contestants: as they were evaluated; those that are built in have no digest.

    """
    files = [Path(name) for name in contestants if name not in BUILT_IN]
    policies = ", ".join(f"{title(str(path))} `{digest(path)}`" for path in files) or "none"
    state = git_state()
    commit = f"`{state.commit[:7]}`" if state.commit else "unknown"
    changed = ", with changes" if state.changed_files else ""
    return f"Policy: {policies}; commit {commit}{changed}."


def digest(path: Path) -> str:
    """The first 12 digits of a file's SHA-256, as `workstation models` shows them."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]
