"""Of which policy, and made with which code, a page of results is."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from mbot_workstation.learn.drivers.contestants import BUILT_IN, title
from mbot_workstation.learn.learning.git_state import GitState, git_state

# Files there change nothing that a page is computed from: pages are written one after another, and
# a policy has its digest. Objects count.
NO_CODE = ("docs/", "models/red-cube", "models/tolerance.json")


def provenance(contestants: Sequence[str], state: GitState | None = None) -> str:
    """One line for the page: "Policy: red-cube `0123456789ab`; commit `0123456`."

    Args:
        contestants: as they were evaluated; those that are built in have no digest.
        state: of the code; this checkout's if not given.

    """
    files = [Path(name) for name in contestants if name not in BUILT_IN]
    policies = ", ".join(f"{title(str(path))} `{digest(path)}`" for path in files) or "none"
    state = state or git_state()
    commit = f"`{state.commit[:7]}`" if state.commit else "unknown"
    code = [name for name in state.changed_files if not name.startswith(NO_CODE)]
    changed = ", with changes" if code else ""
    return f"Policy: {policies}; commit {commit}{changed}."


def digest(path: Path) -> str:
    """The first 12 digits of a file's SHA-256, as `workstation models` shows them."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:12]
