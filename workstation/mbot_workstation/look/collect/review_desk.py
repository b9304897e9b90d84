"""The review page where a server takes what is said on it: `workstation console`."""

import secrets
from pathlib import Path

import msgspec

from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.look.collect.review_page import ReviewedDrive, review_page, reviewed
from mbot_workstation.look.collect.reviews import (
    Place,
    Review,
    Verdict,
    drives_in,
    read_review,
    write_review,
)


class ReviewChange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What somebody has said: a verdict on a drive, or where the object is at a beat of it.

    Attributes:
        drive: below the folder that is looked through, as the page has it.
        verdict: None: it is about a beat.
        beat: its number.
        place: where the object is; None: not in view.

    """

    drive: str
    verdict: Verdict | None = None
    beat: int | None = None
    place: Place | None = None


class ReviewDesk:
    """One folder of drives; any thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def page(self) -> tuple[str, str]:
        """The page as of now, and the nonce by which its own script and style may run."""
        nonce, notes = secrets.token_urlsafe(16), list[str]()
        shown: list[ReviewedDrive] = []
        for name, path in self._named().items():
            try:
                drive, review = read_drive(path), read_review(path)
            except ConfigurationError as error:
                notes.append(f"left out: {error}")
                continue
            shown.append(reviewed(path, name, drive, review))
        return review_page(shown, notes, nonce=nonce), nonce

    def change(self, said: bytes) -> str:
        """Write what was said beside its drive; what was done, in words.

        Raises:
            ConfigurationError: it is nothing that can be said, or of no drive in the folder.

        """
        try:
            change = msgspec.json.decode(said, type=ReviewChange)
        except (msgspec.MsgspecError, RecursionError) as error:
            raise ConfigurationError(f"nothing that can be said of a drive: {error}") from None
        path = self._named().get(change.drive)
        if path is None:
            raise ConfigurationError(f"there is no drive {change.drive!r:.80} in {self._folder}")
        write_review(path, _changed(read_review(path), change, read_drive(path)))
        if change.verdict is not None:
            return f"{change.drive}: {change.verdict}"
        return f"{change.drive}: beat {change.beat} {'labelled' if change.place else 'has none'}"

    def _named(self) -> dict[str, Path]:
        return {path.relative_to(self._folder).as_posix(): path for path in drives_in(self._folder)}


def _changed(review: Review, change: ReviewChange, drive: RecordedDrive) -> Review:
    if (change.verdict is None) is (change.beat is None):
        raise ConfigurationError("expected a verdict or a beat")
    if change.verdict is not None:
        return msgspec.structs.replace(review, verdict=change.verdict)
    there = [beat.decision.sequence for beat in drive.beats if beat.encoded]
    if change.beat is None or there.count(change.beat) != 1:
        raise ConfigurationError(f"{drive.name} has no picture of one beat {change.beat}")
    return review.with_label(change.beat, change.place)
