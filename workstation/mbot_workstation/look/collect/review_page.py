"""Fetched drives as one HTML page that needs no other file and no network: judge, and label."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_workstation.look.collect.moments import (
    Stretch,
    differences,
    interventions,
    is_marked,
    marks,
    seen_by_policy,
)
from mbot_workstation.look.collect.reviews import Place, Review
from mbot_workstation.look.drives.drive_figures import DriveFigures, figures
from mbot_workstation.look.drives.drive_page import PageMap, driven_map, picture_uri, wheel_lines
from mbot_workstation.look.drives.driven_path import PathPoint
from mbot_workstation.wording import one_line, typed

TILES = 12
MOST_DIFFERENT = 6


@dataclass(frozen=True, slots=True)
class ReviewTile:
    """One picture to be labelled.

    Attributes:
        beat: its number.
        uri: of the picture, inside the page.
        since_s: when it was.
        hand: whether a person drove; `wrong`: whether it lies in what was marked.
        told: both wheels in [-1, 1].
        policy: what the policy would have done; None: it drove, or was not asked.
        label: where the object is, as far as somebody has said; `is_labelled`: whether.

    """

    beat: int
    uri: str
    since_s: float
    hand: bool
    wrong: bool
    told: tuple[float, float]
    policy: tuple[float, float] | None
    label: Place | None
    is_labelled: bool


@dataclass(frozen=True, slots=True)
class ReviewedDrive:
    """What the page shows of a drive."""

    name: str
    typed: str
    figures: DriveFigures
    review: Review
    hands: Sequence[Stretch]
    marks: Sequence[Stretch]
    strip: Sequence[ReviewTile]
    different: Sequence[ReviewTile]
    lines: Mapping[str, str]
    map: PageMap | None


def reviewed(
    path: Path, name: str, drive: RecordedDrive, review: Review, places: Sequence[PathPoint] = ()
) -> ReviewedDrive:
    """What the page shows of a drive.

    Args:
        path: of the recording, as it is typed in a command.
        name: below the folder that is looked through.
        drive, review: what was recorded, and what was said of it.
        places: where the robot was, as far as that is known.

    """
    found, wrong = figures(drive), marks(drive)
    differ = {one.beat.key: one for one in differences(drive, MOST_DIFFERENT)}
    policy = {key: one.policy for key, one in differ.items()}
    shown = [beat for beat in drive.beats if beat.key in differ]
    shown.sort(key=lambda beat: -differ[beat.key].size)

    def tiles(beats: Sequence[Beat]) -> list[ReviewTile]:
        made: list[ReviewTile] = []
        for beat in beats:
            picture, number = seen_by_policy(beat), beat.decision.sequence
            if picture is not None:
                made.append(
                    ReviewTile(
                        number,
                        picture_uri(picture),
                        drive.since_s(beat),
                        beat.by_hand,
                        is_marked(drive, wrong, beat),
                        drive.at_wheels(beat),
                        policy.get(beat.key),
                        review.labels.get(str(number)),
                        str(number) in review.labels,
                    )
                )
        return made

    return ReviewedDrive(
        name,
        typed(path),
        found,
        review,
        interventions(drive),
        wrong,
        tiles(found.chosen(TILES)),
        tiles(shown),
        wheel_lines(found),
        driven_map(found, places),
    )


def review_page(
    drives: Sequence[ReviewedDrive], notes: Sequence[str] = (), *, nonce: str = ""
) -> str:
    """The whole page.

    Args:
        drives: in order.
        notes: what could not be read, in words.
        nonce: of the server that takes what is said on the page; empty: the page is a file, and
            collects the commands to be typed instead.

    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["one_line"] = one_line
    counts = {
        word: sum(one.review.verdict == word for one in drives)
        for word in ("keep", "drop", "undecided")
    }
    return environment.get_template("review_page.html").render(
        drives=drives,
        notes=notes,
        nonce=nonce,
        counts=counts,
        labels=sum(len(one.review.labels) for one in drives),
    )
