"""docs/learn-from-drives.md followed as printed, among drives with the names that it prints."""

from pathlib import Path

import pytest

from mbot_workstation.look.collect.reviews import read_review
from mbot_workstation.look.collect.reviews import review_file as review_of

from ..printed_commands import CHECKOUT, blocks
from ..workstation.hand_driven import hand_driven
from .test_printed_commands import prepare, run

PAGE = CHECKOUT / "docs" / "learn-from-drives.md"
NAMES = (
    "drive-0012-20261122-171501",
    "drive-0013-20261122-172004",
    "drive-0014-20261122-173110",
)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_what_the_page_prints_does_what_it_says(tmp_path: Path) -> None:
    prepare(tmp_path)
    for number, name in enumerate(NAMES, 1):
        hand_driven(tmp_path / "drives" / "mbot-1" / name, seed=number)
    printed = [block for block in blocks(PAGE) if "test_learn_from_drives" in block.run_by]
    assert len(printed) == 3
    for block in printed:
        run(block, tmp_path, "nobody")
    first = tmp_path / "drives" / "mbot-1" / NAMES[0]
    assert read_review(first).labels["105"] is None
    assert read_review(first.with_name(NAMES[1])).verdict == "drop"
    parts = {read_review(first.with_name(name)).part for name in (NAMES[0], NAMES[2])}
    assert parts == {"training", "judging"}
    assert len(list((tmp_path / "labelled").rglob("*.png"))) == 3
    assert len(list((tmp_path / "tables").rglob("*.csv"))) == 2
    shown = PAGE.read_text().partition("```json\n")[2].partition("```")[0]
    there = review_of(first).read_text().replace('"judging"', '"training"')
    assert shown == there, "what the page shows is what is written"
