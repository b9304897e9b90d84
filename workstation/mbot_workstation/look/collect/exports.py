"""Kept drives for other programs: labelled pictures, tables of beats, frames."""

import csv
import hashlib
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import atan, degrees, radians, tan
from pathlib import Path
from typing import Any

import msgspec

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.fields import drive_numbers, drive_schema
from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.policy.policy_contract import FieldOfView
from mbot_workstation.learn.evaluation.labelled_pictures import COLUMNS, TRUTH_FILE, VIEW_COLUMNS
from mbot_workstation.look.collect.moments import seen_by_policy, would_have_done
from mbot_workstation.look.collect.reviews import Part, Place, read_review
from mbot_workstation.pictures.picture_file import encode_picture
from mbot_workstation.wording import one_line

Kept = Mapping[Part, Sequence[Path]]


def bearing_left_deg(place: Place, view: FieldOfView) -> float:
    """Where an object is, left positive, by its place in a picture of a level camera."""
    return degrees(atan((1 - 2 * place.x) * tan(radians(view.horizontal_deg) / 2)))


def file_name(drive: Path) -> str:
    """A drive's name as a file's, with its robot's folder: whatever a stranger called it."""
    drive = drive.absolute()
    name = f"{drive.parent.name}-{drive.stem}"
    safe = re.sub(r"[^\w-]+", "_", name)
    return safe if safe == name else f"{safe}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def empty_folder(folder: Path) -> Path:
    """Make it; raises ConfigurationError where there is anything in it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise ConfigurationError(f"{folder} is not empty; choose another folder")
    except OSError as error:
        raise ConfigurationError(f"can't make {folder}: {error.strerror}") from None
    return folder


def write_pictures(folder: Path, kept: Kept) -> tuple[dict[str, int], list[str]]:
    """The labelled pictures of each part, as `evaluate --pictures` reads them.

    Returns:
        How many there are by part, and what was left out, in words.

    """
    counts: dict[str, int] = {}
    notes: list[str] = []
    for part, drives in kept.items():
        rows: list[list[Any]] = []
        for drive in drives:
            labels = dict(read_review(drive).labels)
            if not labels:
                continue
            for beat in read_drive(drive).beats:
                number = str(beat.decision.sequence)
                if number not in labels:
                    continue
                place, view, seen = labels.pop(number), _view(beat), seen_by_policy(beat)
                if view is None or seen is None:
                    notes.append(f"{drive.name}: beat {number} lacks its picture, or what it shows")
                    continue
                name = f"{file_name(drive)}-{number}.png"
                save_in_folder(folder / part / name, encode_picture(seen, ".png"))
                bearing = "" if place is None else f"{bearing_left_deg(place, view):.2f}"
                in_view = int(place is not None)
                rows.append([name, in_view, bearing, view.horizontal_deg, view.vertical_deg])
            notes += [f"{drive.name}: there is no beat {number} to label" for number in labels]
        if rows:
            save_in_folder(folder / part / TRUTH_FILE, _table([[*COLUMNS, *VIEW_COLUMNS], *rows]))
        counts[part] = len(rows)
    return counts, notes


def write_tables(folder: Path, kept: Kept) -> int:
    """A table of beats a drive, as JSON and viewers have them; how many."""
    names = [*msgspec.json.decode(drive_schema())["properties"], "driven_by", "wrong_says"]
    names.remove("memory")

    def table(path: Path, drive: RecordedDrive) -> None:
        rows: list[list[Any]] = [["since_s", *names]]
        for beat in drive.beats:
            found = drive_numbers(beat.decision, beat.policy_input)
            found["driven_by"] = one_line(beat.decision.driven_by)
            found["wrong_says"] = one_line(beat.decision.wrong_says)
            rows.append([f"{drive.since_s(beat):.3f}", *(found.get(name, "") for name in names)])
        save_in_folder(path.with_name(f"{path.name}.csv"), _table(rows))

    return _each(folder, kept, table)


def write_frames(folder: Path, kept: Kept) -> int:
    """A folder of pictures a drive, named by their beats; how many drives."""

    def frames(path: Path, drive: RecordedDrive) -> None:
        for beat in drive.beats:
            if (seen := seen_by_policy(beat)) is not None:
                name = f"{beat.decision.sequence:08d}.png"
                save_in_folder(path / name, encode_picture(seen, ".png"))

    return _each(folder, kept, frames)


def taught(drive: RecordedDrive) -> Iterator[tuple[Beat, Picture, tuple[float, float], bool]]:
    """The beats that somebody or something drove: what was seen, the wheels, whether by hand."""
    for beat in drive.beats:
        seen = seen_by_policy(beat)
        if seen is not None and (beat.by_hand or beat.decided):
            yield beat, seen, drive.at_wheels(beat), beat.by_hand


def policy_answer(beat: Beat) -> tuple[float, float] | None:
    """What the policy answered, whether or not a hand drove; None: it was not asked."""
    if beat.decided:
        return beat.decision.action.left, beat.decision.action.right
    return would_have_done(beat)


def _view(beat: Beat) -> FieldOfView | None:
    try:
        return beat.view
    except ConfigurationError:  # a stranger's, which is none
        return None


def _each(folder: Path, kept: Kept, write: Callable[[Path, RecordedDrive], None]) -> int:
    for part, drives in kept.items():
        for drive in drives:
            write(folder / part / file_name(drive), read_drive(drive))
    return sum(len(drives) for drives in kept.values())


def _table(rows: Sequence[Sequence[Any]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def save_in_folder(path: Path, data: bytes) -> None:
    """Write a file whole, its folder made if need be; raises ConfigurationError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    atomic_file.save(path, data)
