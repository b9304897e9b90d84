"""Scores on labelled pictures as a table and as JSON."""

from collections.abc import Mapping

from rich.table import Table

from mbot_workstation.learn.evaluation.labelled_pictures import PictureScore, Share

COLUMNS = {
    "wrong_way": "turned the wrong way",
    "not_ahead": "did not go ahead",
    "fooled": "drove on at nothing",
}


def picture_table(scores: Mapping[str, PictureScore], title: str) -> Table:
    """One row a policy; counts with the share's interval of 95 %."""
    made = Table(title=title, title_justify="left")
    made.add_column("policy")
    for words in COLUMNS.values():
        made.add_column(words, justify="right")
    for name, score in scores.items():
        made.add_row(name, *(_words(getattr(score, column)) for column in COLUMNS))
    return made


def picture_fields(name: str, score: PictureScore) -> dict[str, object]:
    """One policy's score as a JSON object; the pictures that count are named."""
    shares: dict[str, Share] = {column: getattr(score, column) for column in COLUMNS}
    fields: dict[str, object] = {"policy": name}
    for column, share in shares.items():
        low, high = share.interval
        fields[column] = {"pictures": list(share.names), "of": share.total, "interval": [low, high]}
    return fields


def _words(share: Share) -> str:
    low, high = share.interval
    return f"{len(share.names)} of {share.total} ({low:.0%} to {high:.0%})"
