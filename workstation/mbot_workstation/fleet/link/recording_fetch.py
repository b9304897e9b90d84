"""The recordings that a robot keeps: list them, bring them here, keep or remove them there."""

import hashlib
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from google.protobuf.message import Message

from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.v1.recordings_pb2 import (
    ListedDrive,
    ListedFile,
    RecordingDigest,
    RecordingDigestReply,
    RecordingKeep,
    RecordingList,
    RecordingPart,
    RecordingRead,
    RecordingRemove,
)
from mbot_protocol.wire.keys import (
    CHUNK_BYTES,
    RECORDING_DIGEST,
    RECORDING_KEEP,
    RECORDING_READ,
    RECORDING_REMOVE,
    RECORDINGS,
    Topic,
)
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.wording import one_line

TIMEOUT_S = 10.0
DIGEST_TIMEOUT_S = 60.0
"""The robot reads the whole file from its card before it answers."""

PIECE_EVERY_S = 0.005
"""At most 200 a second, 13 MB/s: who may only look and asks a robot far more often is shown out."""

PART = ".part"

_SAFE_DRIVE = re.compile(r"drive-(\d{4,9})-\d{8}-\d{6}")
_SAFE_FILE = re.compile(r"\d{3,6}\.mcap")

Progress = Callable[[int, int], None]
"""Called with the bytes that are here and the bytes in all."""

R = TypeVar("R", RecordingList, RecordingPart, RecordingDigestReply)


def list_recordings(link: RobotLink) -> RecordingList:
    """What the robot keeps, newest first; raises as `RobotLink.query`, and RefusedError."""
    return _ask(link, RECORDINGS, None, RecordingList)


def choose(drives: list[ListedDrive], wanted: str) -> ListedDrive:
    """The drive that a person means by a number, the beginning of a name, or "last".

    Raises:
        ConfigurationError: there is none or several.

    """
    if wanted == "last" and drives:
        return drives[0]
    number = f"drive-{int(wanted):04d}-" if wanted.isdecimal() else wanted
    fitting = [drive for drive in drives if drive.name.startswith(number)]
    if len(fitting) != 1:
        there = ", ".join(one_line(drive.name) for drive in drives[:3])
        raise ConfigurationError(
            f"{len(fitting)} recordings fit {wanted!r}; expected a number, a name or 'last'"
            + (f", such as {there}" if there else ": the robot keeps none")
        )
    return fitting[0]


def fetch(
    link: RobotLink,
    drive: ListedDrive,
    into: Path,
    on_progress: Progress = lambda _here, _all: None,
) -> Path:
    """Bring a drive here, as far as it has been written; what is here already is not sent again.

    Args:
        link: to the robot.
        drive: as listed.
        into: the folder in which the robot's folder is made.
        on_progress: hears of every piece.

    Returns:
        The drive's folder here: INTO/ROBOT/DRIVE.

    Raises:
        ConfigurationError: nothing can be written here.
        RefusedError: the robot does not have it any more, or what came is not what it has.
        UnreachableError: the link broke; the next fetch goes on from there.

    """
    if not _SAFE_DRIVE.fullmatch(drive.name):
        raise RefusedError(f"the robot names a recording {one_line(drive.name)!r}: not fetched")
    folder = into / link.robot_id / drive.name
    size_bytes = sum(file.size_bytes for file in drive.files)
    before_bytes = 0
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file in drive.files:
            done = before_bytes
            _fetch_file(
                link, drive.name, file, folder, lambda b, d=done: on_progress(d + b, size_bytes)
            )
            before_bytes += file.size_bytes
    except OSError as error:
        raise ConfigurationError(f"can't write {folder}: {error.strerror}") from None
    return folder


def keep(link: RobotLink, drive: str, *, kept: bool) -> RecordingList:
    """Mark a drive so that it stays on the robot, or not; raises as `list_recordings`."""
    request = RecordingKeep(
        schema_version=SCHEMA_VERSION, robot_id=link.robot_id, drive=drive, kept=kept
    )
    return _ask(link, RECORDING_KEEP, request, RecordingList)


def remove(link: RobotLink, drive: str) -> RecordingList:
    """Remove a drive from the robot for good; raises as `list_recordings`."""
    request = RecordingRemove(schema_version=SCHEMA_VERSION, robot_id=link.robot_id, drive=drive)
    return _ask(link, RECORDING_REMOVE, request, RecordingList)


def _fetch_file(
    link: RobotLink, drive: str, file: ListedFile, folder: Path, on_piece: Callable[[int], None]
) -> None:
    if not _SAFE_FILE.fullmatch(file.name):
        raise RefusedError(f"the robot names a file {one_line(file.name)!r}: not fetched")
    whole = folder / file.name
    part = whole.with_name(file.name + PART)
    if whole.exists():
        whole.replace(part)  # it may have grown since, and is checked again
    if part.exists() and part.stat().st_size > file.size_bytes:
        part.unlink()
    hashed = hashlib.sha256(part.read_bytes() if part.exists() else b"")
    next_s = 0.0
    with part.open("ab") as out:
        while (at := out.tell()) < file.size_bytes:
            request = RecordingRead(
                schema_version=SCHEMA_VERSION,
                robot_id=link.robot_id,
                drive=drive,
                file=file.name,
                offset_bytes=at,
                count_bytes=min(CHUNK_BYTES, file.size_bytes - at),
            )
            time.sleep(max(0.0, next_s - time.monotonic()))
            next_s = time.monotonic() + PIECE_EVERY_S
            data = _ask(link, RECORDING_READ, request, RecordingPart).data
            if not 0 < len(data) <= request.count_bytes:
                raise RefusedError(
                    f"robot {link.robot_id} sent {len(data)} bytes of {drive}/{file.name} from "
                    f"{at} on, expected {request.count_bytes}"
                )
            out.write(data)
            hashed.update(data)
            on_piece(out.tell())
    request = RecordingDigest(
        schema_version=SCHEMA_VERSION,
        robot_id=link.robot_id,
        drive=drive,
        file=file.name,
        size_bytes=file.size_bytes,
    )
    reply = _ask(link, RECORDING_DIGEST, request, RecordingDigestReply, DIGEST_TIMEOUT_S)
    if reply.sha256 != hashed.hexdigest():
        part.unlink()
        raise RefusedError(
            f"{drive}/{file.name} is not what robot {link.robot_id} has (its digest differs); it "
            "was thrown away: fetch again"
        )
    part.replace(whole)


def _ask(
    link: RobotLink,
    topic: Topic,
    request: Message | None,
    kind: type[R],
    timeout_s: float = TIMEOUT_S,
) -> R:
    reply = link.query(topic, request, kind, timeout_s)
    if not reply.accepted:
        raise RefusedError(f"robot {link.robot_id} refused: {one_line(reply.reason)}")
    return reply
