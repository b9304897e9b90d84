"""The Python that README.md and docs/python.md print, as printed, on a virtual robot."""

import re
from pathlib import Path

import pytest

from .test_examples import run

CHECKOUT = Path(__file__).parents[2]
PAGES = (CHECKOUT / "README.md", CHECKOUT / "docs" / "python.md")
REAL, VIRTUAL = 'Robot("mbot-1")', 'Robot.virtual(policy="servo")'
"""The pages say to write the one for the other."""

BLOCKS = [
    pytest.param(block, id=f"{page.name}-{number}")
    for page in PAGES
    for number, block in enumerate(
        re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)
    )
]


def test_the_pages_say_how_to_do_without_a_robot() -> None:
    assert len(BLOCKS) == 3
    for page in PAGES:
        assert REAL in page.read_text()
        assert VIRTUAL in page.read_text()


@pytest.mark.slow
@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_runs_as_printed(block: str) -> None:
    code, out, errors = run("-c", block.replace(REAL, VIRTUAL))
    assert (code, errors) == (0, "")
    assert "make_env" in block or re.search(r"running \(-?\d", out), out
