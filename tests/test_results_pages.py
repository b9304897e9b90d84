"""Every page of results says of which policy and commit it is, and is of the one that ships."""

import hashlib
import re
from pathlib import Path

import pytest

from mbot_workstation.learn.studies.tolerance_file import read_tolerances

CHECKOUT = Path(__file__).parents[1]
PAGES = sorted((CHECKOUT / "docs" / "results").glob("*.md"))
LINE = re.compile(r"^Policy: (none|.+); commit (`[0-9a-f]{7,40}`(, with changes)?)\.$", re.M)
SHIPPED = re.compile(r"red-cube `([0-9a-f]{12})`")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_names_its_policy_and_commit(page: Path) -> None:
    text = page.read_text()
    said = LINE.search(text)
    assert said is not None, "no line 'Policy: NAME `digest`; commit `...`.'"
    if said[1] == "none":
        assert "red-cube" not in text
        return
    digest = hashlib.sha256((CHECKOUT / "models" / "red-cube.onnx").read_bytes()).hexdigest()
    assert SHIPPED.findall(said[1]) == [digest[:12]], "made with another policy: make it anew"


def test_what_the_shipped_policy_tolerates_is_of_this_policy() -> None:
    how = read_tolerances(CHECKOUT / "models" / "tolerance.json").how
    digest = hashlib.sha256((CHECKOUT / "models" / "red-cube.onnx").read_bytes()).hexdigest()
    assert SHIPPED.findall(how) == [digest[:12]], "`workstation study tolerance` makes it anew"


def test_there_are_pages() -> None:
    assert len(PAGES) >= 4
