"""The signed manifest of a release of the daemon: what is in it, for which system, and how old.

JSON that has one form only, as a model's manifest; `envelope.py` has the signatures.
Standard library only: the robot's updater reads it without anything of the daemon's.
"""

import json
import re
from dataclasses import asdict, dataclass
from typing import Any

from mbot_protocol.errors import NewerSchemaError, RefusedError

FORMAT = 1
LARGEST_RELEASE_BYTES = 400 << 20

SYSTEMS = ("bookworm", "trixie")
ARCHITECTURES = ("arm64", "amd64")

_VERSION = re.compile(r"[0-9][A-Za-z0-9.+_-]{0,63}")
_PATH = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+-]*(/[A-Za-z0-9_][A-Za-z0-9_.+-]*){0,4}")
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True)
class ReleaseFile:
    """One file of a release.

    Attributes:
        path: where it lies in the archive, relative, with '/'.
        size_bytes, sha256: of its content.

    """

    path: str
    size_bytes: int
    sha256: str


@dataclass(frozen=True, slots=True)
class ReleaseManifest:
    """What a signature vouches for.

    Attributes:
        version: the release's name, also of its folder on the robot.
        sequence: grows from release to release.
        floor: once this release is accepted, none with a smaller sequence is taken any more.
        system: Debian's code name, `SYSTEMS`.
        architecture: as dpkg names it, `ARCHITECTURES`.
        python: of the system, such as "3.11".
        installed_bytes: room that it takes once installed.
        files: all but the manifest and its signatures, in the order in which they come.

    """

    version: str
    sequence: int
    floor: int
    system: str
    architecture: str
    python: str
    installed_bytes: int
    files: tuple[ReleaseFile, ...]
    format: int = FORMAT


def check_version(version: str) -> str:
    """Return the version if it can name a folder.

    Raises:
        RefusedError: it can't.

    """
    if not _VERSION.fullmatch(version):
        raise RefusedError(
            f"the release's version is {version[:80]!r}, expected a digit and up to 63 letters, "
            "digits, '.', '+', '-', '_'"
        )
    return version


def encode(manifest: ReleaseManifest) -> bytes:
    """The one form of this manifest in bytes."""
    return json.dumps(asdict(manifest), sort_keys=True, separators=(",", ":")).encode()


def decode(data: bytes) -> ReleaseManifest:
    """Read a manifest. Only bytes whose signature is known to be good belong here.

    Raises:
        NewerSchemaError: it is of a newer kind.
        RefusedError: it is not a manifest, out of range, or not in its one form.

    """
    try:
        found: dict[str, Any] = json.loads(data)
        newest = int(found.get("format", 0))
        if newest > FORMAT:
            raise NewerSchemaError(
                f"the release's manifest has format {newest}, this software knows up to {FORMAT}: "
                "install a release in between first"
            )
        manifest = _built(found)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise RefusedError("the release's manifest is unusable: it is not a manifest") from None
    if encode(manifest) != data:
        raise RefusedError("the release's manifest is unusable: not in its one canonical form")
    return manifest


def _built(found: dict[str, Any]) -> ReleaseManifest:
    """From JSON; any exception of Python's means that it is not a manifest."""
    entries: list[dict[str, Any]] = found.pop("files")
    files = tuple(ReleaseFile(**entry) for entry in entries)
    manifest = ReleaseManifest(**found, files=files)
    numbers: tuple[Any, ...] = (
        *(manifest.sequence, manifest.floor, manifest.installed_bytes, manifest.format),
        *(file.size_bytes for file in files),
    )
    texts: tuple[Any, ...] = (manifest.system, manifest.architecture, manifest.python)
    if not all(type(number) is int and 0 <= number < 2**63 for number in numbers):
        raise ValueError
    if not all(type(text) is str and len(text) <= 80 for text in texts):
        raise ValueError
    check_version(manifest.version)
    if not all(_PATH.fullmatch(file.path) and _SHA256.fullmatch(file.sha256) for file in files):
        raise ValueError
    if len({file.path for file in files}) < len(files) or not files:
        raise ValueError
    return manifest
