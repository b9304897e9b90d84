"""What a robot remembers of its releases, as a value, and which releases it refuses.

Kept by the updater as `/opt/mbot-agent/ledger.json`, for everybody to read. Which release runs is
not here: the link `current` says that, and nothing else does. Standard library only.
"""

import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.release_manifest import ReleaseManifest

APPLICATION = Path("/opt/mbot-agent")
RESERVE_BYTES = 64 << 20
"""Stays free: logs and models go on."""

REMEMBERED = 50

UNDER_FIRE = "under-fire"
"""A file in the daemon's folder, touched while somebody floods it with messages."""

BUSY = ("checking", "building", "trying")
"""Phases of an update that goes on."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of the last update, or how far it is.

    Attributes:
        request: which one: the number of its push; empty: not by a push.
        version: of the release; empty before it is known.
        phase: one of `BUSY`, or "installed", "refused", "failed", "rolled-back".
        detail: one line for people.

    """

    request: str = ""
    version: str = ""
    phase: str = ""
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Ledger:
    """Releases by version; empty: none.

    Attributes:
        golden: the first one installed, never removed.
        previous: what was replaced last.
        floor: no release with a smaller sequence is taken.
        rejected: those that were rolled back, with the reason; not taken again.
        came_from: while a release is tried: what to go back to. A power cut then goes back, too.
        outcome: of the last update.

    """

    golden: str = ""
    previous: str = ""
    floor: int = 0
    rejected: dict[str, str] = field(default_factory=dict[str, str])
    came_from: str = ""
    outcome: Outcome = Outcome()

    def to_bytes(self) -> bytes:
        """For the file."""
        return json.dumps(asdict(self), indent=1, sort_keys=True).encode()

    def with_rejected(self, version: str, reason: str) -> "Ledger":
        """This release is not to be taken again."""
        rejected = {name: why for name, why in self.rejected.items() if name != version}
        rejected[version] = reason
        return replace(self, rejected=dict(list(rejected.items())[-REMEMBERED:]))

    def accepted(self, version: str, old: str, floor: int) -> "Ledger":
        """This release has taken the place of the old one."""
        return replace(
            self,
            golden=self.golden or version,
            previous=old if old != version else self.previous,
            floor=max(self.floor, floor),
            rejected={name: why for name, why in self.rejected.items() if name != version},
            came_from="",
        )


def read_ledger(path: Path) -> Ledger:
    """The ledger; an empty one where there is none.

    Raises:
        RefusedError: it is damaged or unreadable: nothing may be decided on it.

    """
    try:
        found: dict[str, Any] = json.loads(path.read_bytes())
        outcome: dict[str, Any] = found.pop("outcome")
        return Ledger(**found, outcome=Outcome(**outcome))
    except FileNotFoundError:
        return Ledger()
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise RefusedError(
            f"{path} is unreadable ({error}): install a release with deploy/install.sh after "
            "removing it"
        ) from None


@dataclass(frozen=True, slots=True)
class Computer:
    """What a release must fit.

    Attributes:
        system, architecture, python: as in the manifest.
        free_bytes: on the disk of /opt.

    """

    system: str
    architecture: str
    python: str
    free_bytes: int


def check_release(
    manifest: ReleaseManifest, ledger: Ledger, computer: Computer, needed_bytes: int
) -> None:
    """Is this a release for this robot, now?

    Raises:
        RefusedError: no, for this reason.

    """
    found = f"{manifest.system} on {manifest.architecture}"
    own = f"{computer.system} on {computer.architecture}"
    if found != own:
        raise RefusedError(f"the release is for {found}, this robot is {own}: send that one")
    if manifest.python != computer.python:
        raise RefusedError(
            f"the release is for Python {manifest.python}, this robot has {computer.python}"
        )
    if manifest.version in ledger.rejected:
        raise RefusedError(
            f"{manifest.version} was rolled back on this robot before: "
            f"{ledger.rejected[manifest.version]}"
        )
    if manifest.sequence < ledger.floor:
        raise RefusedError(
            f"{manifest.version} is a downgrade: its sequence {manifest.sequence} is below "
            f"{ledger.floor}, the floor of the releases installed since"
        )
    if computer.free_bytes < needed_bytes + RESERVE_BYTES:
        raise RefusedError(
            f"the robot's disk is full: needs {(needed_bytes + RESERVE_BYTES) / 1e6:.0f} MB, has "
            f"{computer.free_bytes / 1e6:.0f} MB"
        )
