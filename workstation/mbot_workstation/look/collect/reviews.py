"""What a person has said of a fetched drive: a small JSON file beside it, never in the recording.

`drives/mbot-1/drive-0012-20261122-171501` is reviewed in `drive-0012-20261122-171501.review.json`.
"""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import text_if_any

ENDING = ".review.json"

Verdict = Literal["undecided", "keep", "drop"]
Part = Literal["training", "judging"]
_Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class Place(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the object is in a picture: shares of its sides, from the left and from above."""

    x: _Share
    y: _Share


class Review(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One drive, as a person judges it.

    Attributes:
        verdict: whether something is to be learned from it.
        part: what for: a whole drive is one or the other, as its pictures are much alike.
        labels: by the numbers of beats, where the object is; null: not in view.

    """

    verdict: Verdict = "undecided"
    part: Part | None = None
    labels: dict[str, Place | None] = {}

    def with_label(self, beat: int, place: Place | None) -> "Review":
        """The same with one more label; an older one of that beat is forgotten."""
        return msgspec.structs.replace(self, labels=self.labels | {str(beat): place})


def review_file(drive: Path) -> Path:
    """Where a drive's review stands, whether or not there is one."""
    drive = drive.absolute()
    return drive.with_name(drive.name + ENDING)


def read_review(drive: Path) -> Review:
    """A drive's review; the blank one if nobody has looked yet.

    Raises:
        ConfigurationError: there is a file that is none.

    """
    path = review_file(drive)
    text = text_if_any(path)
    if text is None:
        return Review()
    try:
        found = msgspec.json.decode(text, type=Review)
        if not all(key.isascii() and key.isdecimal() for key in found.labels):
            raise ValueError("a label is not of a beat's number")
        return found
    except (ValueError, RecursionError) as error:  # of msgspec too
        raise ConfigurationError(f"{path}: {error}; mend it, or take it away") from None


def write_review(drive: Path, review: Review) -> None:
    """Replace a drive's review, whole or not at all; raises ConfigurationError."""
    text = msgspec.json.format(msgspec.json.encode(review), indent=2) + b"\n"
    atomic_file.save(review_file(drive), text)


def drives_in(folder: Path) -> list[Path]:
    """All drives below a folder: folders of numbered files as a robot writes them, and other files.

    Raises:
        ConfigurationError: there is none.

    """
    files = sorted(folder.rglob("*.mcap")) if folder.is_dir() else []
    found = dict.fromkeys(path.parent if path.stem.isdecimal() else path for path in files)
    if not found:
        raise ConfigurationError(
            f"no drives in {folder}: `workstation recordings fetch --all` brings them into drives"
        )
    return list(found)


def split(reviews: Mapping[Path, Review], judging: float) -> dict[Path, Review]:
    """Those of the kept drives that are neither for training nor for judging yet, with their part.

    What has a part stays: nothing is ever judged by what has been trained on. Which of the others
    is for judging is chance, the same in each run.

    Args:
        reviews: by their drives.
        judging: what share of all kept drives is to be for judging; one at least.

    """
    kept = {drive: one for drive, one in reviews.items() if one.verdict == "keep"}
    open_ = sorted(
        (drive for drive, one in kept.items() if one.part is None),
        key=lambda drive: hashlib.sha256(drive.name.encode()).digest(),
    )
    there = sum(one.part == "judging" for one in kept.values())
    lacking = max(0, max(1, round(judging * len(kept))) - there)
    return {
        drive: msgspec.structs.replace(
            kept[drive], part="judging" if number < lacking else "training"
        )
        for number, drive in enumerate(open_)
    }


def kept_for(reviews: Mapping[Path, Review], parts: Iterable[Part]) -> dict[Part, list[Path]]:
    """The kept drives of each part.

    Raises:
        ConfigurationError: none is kept, or one that is has no part.

    """
    kept = {drive: one for drive, one in reviews.items() if one.verdict == "keep"}
    if not kept:
        raise ConfigurationError("no drive is kept yet: `workstation drives keep DRIVE`")
    if without := [drive.name for drive, one in kept.items() if one.part is None]:
        raise ConfigurationError(
            f"{without[0]} is neither for training nor for judging: `workstation drives split`"
        )
    return {part: [d for d, one in kept.items() if one.part == part] for part in parts}
