"""Every page of results says of which policy and commit it is; a release has those that ship."""

import hashlib
import os
import re
import warnings
from pathlib import Path

import pytest

from mbot_workstation.learn.studies.tolerance_file import read_tolerances

CHECKOUT = Path(__file__).parents[1]
RESULTS = CHECKOUT / "docs" / "results"
PAGES = [*sorted(RESULTS.glob("*.md")), CHECKOUT / "docs" / "notebook" / "lesson-10.md"]
TOLERANCES = CHECKOUT / "models" / "tolerance.json"
LINE = re.compile(r"^Policy: (none|.+); commit (`[0-9a-f]{7,40}`(, with changes)?)\.$", re.M)
SHIPPED = re.compile(r"red-cube `([0-9a-f]{12})`")
RENEWED = "`make policy-pages` renews them, identification.md benchmarks/identification.py"


def made_with(page: Path) -> str:
    """The policies that a page's line names."""
    said = LINE.search(page.read_text())
    assert said is not None, "no line 'Policy: NAME `digest`; commit `...`.'"
    return said[1]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: "-".join(page.parts[-2:]))
def test_a_page_names_its_policy_and_commit(page: Path) -> None:
    if made_with(page) == "none":
        assert "red-cube" not in page.read_text()
    else:
        assert len(SHIPPED.findall(made_with(page))) == 1


def test_the_pages_are_of_the_policy_that_ships() -> None:
    """While a policy is worked on its pages may lag behind; a release has its own."""
    digest = hashlib.sha256((CHECKOUT / "models" / "red-cube.onnx").read_bytes()).hexdigest()[:12]
    named = {page: made_with(page) for page in PAGES}
    named = {page: policy for page, policy in named.items() if policy != "none"}
    named[TOLERANCES] = read_tolerances(TOLERANCES).how
    assert len(named) >= 6
    old = [
        str(page.relative_to(CHECKOUT))
        for page, policy in named.items()
        if SHIPPED.findall(policy) != [digest]
    ]
    said = f"not of red-cube {digest}: {', '.join(old)}; {RENEWED}"
    if old and os.environ.get("MBOT_RELEASE") != "1":
        warnings.warn(said, stacklevel=1)
    else:
        assert not old, said
