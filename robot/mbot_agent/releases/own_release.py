"""Which release this daemon runs from, and whether the updater is at work."""

import sys
from pathlib import Path

from mbot_protocol.signing.release_ledger import APPLICATION

UPDATER_WORKS = Path("/run/mbot-agent-update")
"""systemd makes it when the updater starts and removes it when that ends, however it does."""

REQUEST, ARCHIVE = "request", "incoming.tar"
"""What the updater looks for in the daemon's inbox."""


def own_release(prefix: str = sys.prefix) -> str:
    """The version; empty where it does not run from an installed release."""
    folder = Path(prefix).parent
    return folder.name if folder.parent == APPLICATION / "releases" else ""


def update_goes_on(inbox: Path, updater_works: Path = UPDATER_WORKS) -> bool:
    """Whether a release is waiting for the updater, or being installed."""
    return (inbox / REQUEST).exists() or updater_works.exists()
