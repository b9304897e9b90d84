"""The shell blocks of the documents, and what they need.

A block is indented by four spaces, or fenced with lines that begin with `$ `. A comment before it
says why it can't be run here, where else it is run, or what would take too long:

    <!-- needs: a robot -->
    <!-- run by: tests/end_to_end/test_readme_recipe.py -->
    <!-- shorter: train --steps 600; evaluate --episodes 1 -->
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

CHECKOUT = Path(__file__).parents[1]
PAGES = (CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md")))

_NOTE = re.compile(r"<!-- (needs|run by|shorter): (.*?) -->")
_COMMAND = re.compile(r"(make|workstation|mbot-agent|ssh|sudo|systemctl|export|echo|mv|cp|\S*pip) ")


@dataclass(frozen=True)
class Block:
    """Commands as printed.

    Attributes:
        page, line: where; the line counts from 1.
        script: without indentation and prompts.
        needs: what no test has; empty if nothing.
        run_by: the test that runs it; empty if it is run as it is.
        shorter: options to add, by subcommand.

    """

    page: Path
    line: int
    script: str
    needs: str = ""
    run_by: str = ""
    shorter: dict[str, str] = field(default_factory=dict)

    @property
    def is_run(self) -> bool:
        """Whether it is run as printed, in the order of its page."""
        return not self.needs and not self.run_by


def blocks(page: Path) -> list[Block]:
    """All shell blocks of a page."""
    lines = page.read_text().splitlines()
    found: list[Block] = []
    notes: dict[str, str] = {}
    at = 0
    while at < len(lines):
        line = lines[at]
        if note := _NOTE.fullmatch(line.strip()):
            notes[note[1]] = note[2]
        elif line.startswith("```"):
            end = next(n for n in range(at + 1, len(lines)) if lines[n].startswith("```"))
            script = [text[2:] for text in lines[at + 1 : end] if text.startswith("$ ")]
            found += _block(page, at + 2, script, notes)
            notes, at = {}, end
        elif line.startswith("    ") and not lines[at - 1].strip():
            end = at
            while end < len(lines) and lines[end].startswith("    "):
                end += 1
            script = [text[4:] for text in lines[at:end]]
            found += _block(page, at + 1, script if _is_shell(script) else [], notes)
            notes, at = {}, end - 1
        elif line.strip():
            notes = {}
        at += 1
    return found


def _is_shell(script: list[str]) -> bool:
    return any(_COMMAND.match(line) for line in script)


def _block(page: Path, line: int, script: list[str], notes: dict[str, str]) -> list[Block]:
    if not script:
        return []
    pairs = (part.strip().partition(" ") for part in notes.get("shorter", "").split(";"))
    shorter = {name: options for name, _, options in pairs if name}
    text = "\n".join(script) + "\n"
    return [Block(page, line, text, notes.get("needs", ""), notes.get("run by", ""), shorter)]
