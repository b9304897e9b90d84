"""Write docs/results/first-hour.md from the table of mistakes that the tests make."""

import runpy
from pathlib import Path

from mbot_workstation.learn.evaluation.provenance import provenance

CHECKOUT = Path(__file__).parents[1]
PAGE = CHECKOUT / "docs" / "results" / "first-hour.md"

if __name__ == "__main__":
    table = runpy.run_path(str(CHECKOUT / "tests" / "mistake_table.py"))
    PAGE.write_text(table["page"](provenance([])))
    print(f"wrote {PAGE.relative_to(CHECKOUT)}")
