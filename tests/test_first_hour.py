"""Every mistake of the first hour is made, and answered by its one line."""

import fcntl
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_workstation.fleet.models.key_folder import KeyFolder

from .mistake_table import MISTAKES, Mistake, page, prepare
from .ran import ran

PAGE = Path(__file__).parents[1] / "docs" / "results" / "first-hour.md"
PROGRAMS = {"workstation": "mbot_workstation.main", "mbot-agent": "mbot_agent.main"}


def test_the_page_is_the_table() -> None:
    text = PAGE.read_text()
    about = next(line for line in text.splitlines() if line.startswith("Policy: "))
    assert text == page(about), "write it by: python benchmarks/first_hour.py"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    made = tmp_path_factory.mktemp("first-hour")
    prepare(made)
    for name in ("anna", "bert"):
        KeyFolder(made / "config" / "mbot-agent" / "keys").new(name)
    with (made / ".board.lock").open("w") as lock:  # as a virtual robot that runs
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield made


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize("mistake", MISTAKES, ids=[one.what for one in MISTAKES])
def test_a_mistake_is_answered_by_its_line(mistake: Mistake, folder: Path) -> None:
    program, *words = mistake.command.split()
    environment = {name: v for name, v in os.environ.items() if not name.startswith("MBOT_")}
    done = ran(
        sys.executable,
        "-m",
        PROGRAMS[program],
        *words,
        env=environment | {"XDG_CONFIG_HOME": "config", "COLUMNS": "80"},
        cwd=folder,
        timeout=300,
    )
    assert done.stderr == mistake.line.replace("{folder}", str(folder)) + "\n"
    assert (done.returncode, done.stdout) == (mistake.code, "")
    assert not (folder.parent / "evil").exists()
