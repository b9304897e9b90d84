"""Lines and modules a room, beside its budget: `make size`. Beyond a budget it fails.

Counted is every line of every Python file that is not generated, comments and docstrings too: what
a reader has to scroll past. A budget is raised in the commit that needs it, which says why.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORKSTATION = "workstation/mbot_workstation"
PROTOCOL = "shared/protocol/mbot_protocol"

BUDGETS = {
    f"{WORKSTATION}/cli": 7000,
    f"{WORKSTATION}/look": 4300,
    f"{WORKSTATION}/measure": 15260,
    f"{WORKSTATION}/learn": 10010,
    f"{WORKSTATION}/virtual": 2965,
    f"{WORKSTATION}/fleet": 7540,
    f"{WORKSTATION}/tasks": 3520,
    f"{WORKSTATION}/sim": 6600,
    f"{WORKSTATION}/pictures": 420,
    WORKSTATION: 330,
    "workstation/mbot": 860,
    PROTOCOL: 5750,
    "robot/mbot_agent": 10170,
    "robot/mbot_update": 1380,
    "tests": 62960,
    "benchmarks": 4975,
}
"""Lines by folder; what lies in a folder with a budget of its own counts there. They are what
stands today; the aim is 50,000 of source in all, 10,000 of them measuring, and 38,000 of tests.
"""


@dataclass(frozen=True, slots=True)
class Room:
    """What a folder holds."""

    name: str
    modules: int
    lines: int
    budget: int

    @property
    def is_over(self) -> bool:
        """Whether it holds more lines than it may."""
        return self.lines > self.budget


def rooms() -> list[Room]:
    """All folders with a budget."""
    files: dict[str, list[int]] = {folder: [] for folder in BUDGETS}
    for side in ("robot", "shared", "workstation", "tests", "benchmarks"):
        for path in (ROOT / side).rglob("*.py"):
            if "_pb2" in path.name or "__pycache__" in path.parts:
                continue
            name = path.relative_to(ROOT).as_posix()
            homes = [folder for folder in BUDGETS if name.startswith(f"{folder}/")]
            if homes:
                files[max(homes, key=len)].append(len(path.read_text().splitlines()))
    return [Room(name, len(lines), sum(lines), BUDGETS[name]) for name, lines in files.items()]


def main() -> None:
    """Print the table; exit with 1 if a room is over its budget."""
    found = rooms()
    print(f"{'room':40} {'modules':>8} {'lines':>8} {'budget':>8}")
    for room in found:
        over = "  over" if room.is_over else ""
        print(f"{room.name:40} {room.modules:8,} {room.lines:8,} {room.budget:8,}{over}")
    source = [room for room in found if room.name not in ("tests", "benchmarks")]
    modules, lines = sum(room.modules for room in source), sum(room.lines for room in source)
    print(f"{'source':40} {modules:8,} {lines:8,}")
    if any(room.is_over for room in found):
        sys.exit("a room is over its budget: take lines away, or say in BUDGETS why not")


if __name__ == "__main__":
    main()
