"""Scores on labelled pictures as a table and as JSON, and a sheet of the mistakes."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.evaluation.labelled_pictures import (
    KINDS,
    PLAIN_KINDS,
    LabelledPicture,
    PictureScore,
    Share,
)
from mbot_workstation.pictures.film_tile import Bar, Tile, strip_of

COLUMNS = 8
"""Of the sheet."""


def picture_table(scores: Mapping[str, PictureScore], title: str) -> Table:
    """Counts with the share's interval of 95 %: a row a policy, or a kind if there are more."""
    kinds = list(next(iter(scores.values())))
    rows = [("policy", *(KINDS[kind] for kind in kinds))]
    rows += [(name, *map(_words, score.values())) for name, score in scores.items()]
    if len(kinds) > len(PLAIN_KINDS):
        rows = list(zip(*rows, strict=True))
    made = Table(title=title, title_justify="left")
    for number, heading in enumerate(rows[0]):
        made.add_column(heading, justify="right" if number else "left")
    for row in rows[1:]:
        made.add_row(*row)
    return made


def picture_fields(name: str, score: PictureScore) -> dict[str, object]:
    """One policy's score as a JSON object; the pictures that count are named."""
    fields: dict[str, object] = {"policy": name}
    for kind, share in score.items():
        low, high = share.interval
        fields[kind] = {"pictures": list(share.names), "of": share.total, "interval": [low, high]}
    return fields


def mistakes_sheet(
    name: str,
    score: PictureScore,
    pictures: Sequence[LabelledPicture],
    seen: NDArray[np.uint8],
    actions: NDArray[np.float32],
) -> Picture:
    """All pictures that a policy got wrong, each once, under its most particular kind.

    Args:
        name: of the policy.
        score: by `judge`.
        pictures: all n that were shown.
        seen: what the policy saw of them, shape (n, 64, 64, 3), RGB.
        actions: shape (n, 2).

    Returns:
        Shape (h, w, 3), RGB; below a picture the object's bearing in degrees, left positive, and
        the wheels.

    """
    number_of = {one.name: number for number, one in enumerate(pictures)}
    shown: set[str] = set()
    strips: list[Picture] = []
    for kind, share in reversed(score.items()):
        tiles: list[Tile] = []
        for picture in (name for name in share.names if name not in shown):
            number = number_of[picture]
            left, right = actions[number].tolist()
            bearing = pictures[number].bearing_left_deg
            words = "" if bearing is None else f"{bearing:+.0f}"
            tiles.append(Tile(seen[number], words, (Bar("L", left), Bar("R", right))))
        shown.update(share.names)
        if tiles:
            strips.append(strip_of(tiles, COLUMNS, f"{name}: {KINDS[kind]}, {len(tiles)}"))
    return np.vstack(strips or [strip_of([], COLUMNS, f"{name}: no mistakes")])


def _words(share: Share) -> str:
    low, high = share.interval
    return f"{len(share.names)} of {share.total} ({low:.0%} to {high:.0%})"
