"""`workstation drives`: look through fetched drives, and keep what is to be learned from."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import json_option
from mbot_workstation.cli.options import argument, check_new_file, option, with_options
from mbot_workstation.cli.presenter import Answer, table
from mbot_workstation.wording import typed

if TYPE_CHECKING:
    from mbot_protocol.beat.recorded_drive import RecordedDrive
    from mbot_workstation.look.collect.reviews import Review

app = typer.Typer(help="Fetched drives: what is to be learned from them.", no_args_is_help=True)

_MARGIN = "Folder that `recordings fetch` has filled."


def _folder() -> Any:
    return argument(_MARGIN, default=Path("drives"), metavar="[FOLDER]")


def _drive(metavar: str = "DRIVE") -> Any:
    return argument("A folder or file that `recordings fetch` has made.", metavar=metavar)


@dataclass(frozen=True, slots=True, kw_only=True)
class ListCollectedOptions:
    """What `drives list` takes."""

    folder: Path = _folder()
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class CollectedDrive:
    """A fetched drive, and what was said of it."""

    path: Path
    sentence: str
    verdict: str
    part: str | None
    labels: int
    marks: int
    by_hand_s: float


@app.command("list")
@with_options
def list_command(options: ListCollectedOptions) -> Answer:
    """List fetched drives with what was said of them.

    Example: `workstation drives list`
    """
    from mbot_workstation.look.collect.moments import marks
    from mbot_workstation.look.drives.drive_figures import figures

    found: list[CollectedDrive] = []
    notes: list[str] = []
    for path, drive, review in _read(options.folder, notes):
        known = figures(drive)
        by_hand_s = round(sum(known.hands.values()), 3)
        parts = review.verdict, review.part, len(review.labels), len(marks(drive)), by_hand_s
        found.append(CollectedDrive(path, known.sentence, *parts))
    headings = ("drive", "verdict", "for", "labels", "marks", "by hand")
    rows = (
        (str(d.path), d.verdict, d.part or "", str(d.labels), str(d.marks), f"{d.by_hand_s:g} s")
        for d in found
    )
    return Answer(found, [table(headings, rows)], notes)


def _read(folder: Path, notes: list[str]) -> "Iterator[tuple[Path, RecordedDrive, Review]]":
    """Each drive with its review; those that can't be read are noted."""
    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.collect.reviews import drives_in, read_review

    for path in drives_in(folder):
        try:
            drive = read_drive(path), read_review(path)
        except ConfigurationError as error:
            notes.append(f"left out: {error}")
            continue
        yield path, *drive


@dataclass(frozen=True, slots=True, kw_only=True)
class ReviewOptions:
    """What `drives review` takes."""

    folder: Path = _folder()
    output: Path = option(
        Path("review.html"), "The page, a new file.", "--output", "-o", metavar="FILE.html"
    )
    maps: list[Path] | None = option(
        None,
        "Also draw the path that `virtual-robot --trajectory` wrote meanwhile. Repeatable.",
        "--map",
        metavar="FILE.jsonl",
    )


@app.command("review")
@with_options
def review_command(options: ReviewOptions) -> Answer:
    """Write all fetched drives as one page: to look through, judge and label.

    Pictures, wheels, who took over, what was marked, where hand and policy differ most. The page
    needs no network and sends nothing; what is said on it is shown as commands to be typed.

    Example: `workstation drives review drives -o review.html`
    """
    from mbot_protocol.files import atomic_file
    from mbot_workstation.look.collect.review_page import review_page, reviewed
    from mbot_workstation.look.drives.driven_path import read_path

    check_new_file(options.output)
    places = [place for path in options.maps or [] for place in read_path(path)]
    notes: list[str] = []
    shown = [
        reviewed(path, path.relative_to(options.folder).as_posix(), drive, review, places)
        for path, drive, review in _read(options.folder, notes)
    ]
    atomic_file.save(options.output, review_page(shown, notes).encode())
    return Answer(options.output, [f"wrote {options.output}: {len(shown)} drives"], notes)


@dataclass(frozen=True, slots=True, kw_only=True)
class KeepDriveOptions:
    """What `drives keep` takes."""

    drives: list[Path] = _drive("DRIVE...")
    part: str | None = option(
        None,
        "training or judging; else `drives split` says.",
        "--for",
        metavar="PART",
    )


@app.command("keep")
@with_options
def keep_command(options: KeepDriveOptions) -> Answer:
    """Keep drives: something is to be learned from them.

    Example: `workstation drives keep drives/mbot-1/drive-0012-20261122-171501`
    """
    if options.part not in (None, "training", "judging"):
        raise ConfigurationError(f"--for is {options.part}, expected training or judging")
    changes = {"verdict": "keep"} | ({"part": options.part} if options.part else {})
    return _changed(options.drives, lambda review: msgspec.structs.replace(review, **changes))


@dataclass(frozen=True, slots=True, kw_only=True)
class DropOptions:
    """What `drives drop` takes."""

    drives: list[Path] = _drive("DRIVE...")


@app.command("drop")
@with_options
def drop_command(options: DropOptions) -> Answer:
    """Drop drives: nothing is to be learned from them. The recordings stay where they are.

    Example: `workstation drives drop drives/mbot-1/drive-0012-20261122-171501`
    """
    return _changed(options.drives, lambda one: msgspec.structs.replace(one, verdict="drop"))


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelOptions:
    """What `drives label` takes."""

    drive: Path = _drive()
    beat: int = argument("Its number, as the page and the recording have it.", metavar="BEAT")
    at: str = option(
        "", "Where the object is: shares from the left and the top.", "--at", metavar="X,Y"
    )
    none: bool = option(False, "It is not in view.", "--none")


@app.command("label")
@with_options
def label_command(options: LabelOptions) -> Answer:
    """Say where the object is in what the policy saw at a beat.

    Example: `workstation drives label drives/mbot-1/drive-0012-20261122-171501 117 --at 0.42,0.6`
    """
    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.look.collect.reviews import Place

    if bool(options.at) == options.none:
        raise ConfigurationError("expected one of: --at X,Y, --none")
    try:
        x, y = options.at.split(",") if options.at else ("0", "0")
        place = msgspec.convert({"x": float(x), "y": float(y)}, Place)
    except ValueError:
        raise ConfigurationError(
            f"--at is {options.at}, expected two shares such as 0.42,0.6"
        ) from None
    there = [beat.decision.sequence for beat in read_drive(options.drive).beats if beat.encoded]
    if there.count(options.beat) != 1:
        raise ConfigurationError(
            f"{options.drive} has {there.count(options.beat)} pictures of beat {options.beat}; "
            f"expected one of {min(there, default=0)} to {max(there, default=0)}"
        )
    where = None if options.none else place
    return _changed([options.drive], lambda review: review.with_label(options.beat, where))


@dataclass(frozen=True, slots=True, kw_only=True)
class SplitOptions:
    """What `drives split` takes."""

    folder: Path = _folder()
    judging: float = option(
        0.2, "Share of the kept drives that is for judging.", "--judging", min=0.01, max=0.99
    )


@app.command("split")
@with_options
def split_command(options: SplitOptions) -> Answer:
    """Say of each kept drive whether it is for training or for judging; what has been said stays.

    By drive, never by picture: those of one drive are much alike.

    Example: `workstation drives split drives --judging 0.2`
    """
    from mbot_workstation.look.collect.reviews import drives_in, read_review, split, write_review

    reviews = {path: read_review(path) for path in drives_in(options.folder)}
    for path, review in split(reviews, options.judging).items():
        write_review(path, review)
        reviews[path] = review
    kept = {path: one.part for path, one in reviews.items() if one.verdict == "keep"}
    parts = {name: sum(part == name for part in kept.values()) for name in ("training", "judging")}
    said = f"{parts['training']} kept drives for training, {parts['judging']} for judging"
    return Answer(parts, [said])


def _changed(drives: Sequence[Path], change: "Callable[[Review], Review]") -> Answer:
    from mbot_workstation.look.collect.reviews import (
        drives_in,
        read_review,
        review_file,
        write_review,
    )

    for path in drives:
        if path not in drives_in(path if path.is_dir() else path.parent):
            raise ConfigurationError(f"{path} is no drive: name one of `workstation drives list`")
    changed = {path: change(read_review(path)) for path in drives}
    for path, review in changed.items():
        write_review(path, review)
    return Answer(list(changed), [f"wrote {review_file(path)}" for path in changed])


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportDrivesOptions:
    """What `drives export` takes."""

    folder: Path = _folder()
    pictures: Path | None = option(
        None,
        "Labelled pictures, a folder a part, each for `evaluate --pictures`.",
        "--pictures",
        metavar="DIR",
    )
    tables: Path | None = option(None, "A table of beats a drive.", "--csv", metavar="DIR")
    frames: Path | None = option(
        None, "A folder of pictures a drive, by beats.", "--frames", metavar="DIR"
    )
    lerobot: Path | None = option(
        None,
        "A LeRobot dataset (v3.0) a part; needs the extra `[lerobot]`.",
        "--lerobot",
        metavar="DIR",
    )


@app.command("export")
@with_options
def export_command(options: ExportDrivesOptions) -> Answer:
    """Write kept drives for other programs, those for training apart from those for judging.

    Example: `workstation drives export drives --pictures labelled`
    """
    from mbot_workstation.look.collect import exports
    from mbot_workstation.look.collect.reviews import drives_in, kept_for, read_review

    given = (options.pictures, options.tables, options.frames, options.lerobot)
    wanted = [path for path in given if path is not None]
    if not wanted:
        raise ConfigurationError("expected at least one of: --pictures, --csv, --frames, --lerobot")
    reviews = {path: read_review(path) for path in drives_in(options.folder)}
    kept = kept_for(reviews, ("training", "judging"))
    for folder in wanted:
        exports.empty_folder(folder)
    said: list[str] = []
    notes: list[str] = []
    if options.pictures is not None:
        counts, notes = exports.write_pictures(options.pictures, kept)
        told = ", ".join(f"{count} for {part}" for part, count in counts.items())
        said.append(f"{options.pictures}: labelled pictures, {told}")
        if counts["judging"]:
            said.append(
                "next: workstation evaluate POLICY.onnx --pictures "
                f"{typed(options.pictures / 'judging')}"
            )
    if options.tables is not None:
        said.append(f"{options.tables}: {exports.write_tables(options.tables, kept)} tables")
    if options.frames is not None:
        said.append(f"{options.frames}: frames of {exports.write_frames(options.frames, kept)}")
    if options.lerobot is not None:
        from mbot_workstation.look.collect.lerobot_set import write_lerobot

        found = write_lerobot(options.lerobot, kept)
        told = ", ".join(f"{count} episodes for {part}" for part, count in found.items())
        said.append(f"{options.lerobot}: {told}")
    return Answer(wanted, said, notes)
