"""Every shell block of README.md and docs that needs no hardware, as printed."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_workstation.sim.scene.room_generator import generate_room

from ..printed_commands import CHECKOUT, PAGES, Block, blocks
from ..workstation.fake_robot import FakeRobot

PROGRAM = """#!{python}
import os, sys
from mbot_workstation.main import main
if __name__ == "__main__":
    shorter = dict(pair.split("=", 1) for pair in os.environ["SHORTER"].split(";") if pair)
    sys.argv += shorter.get(sys.argv[1] if len(sys.argv) > 1 else "", "").split()
    main()
"""
"""`workstation`, with what makes long commands short."""

ALL = [block for page in PAGES for block in blocks(page)]
RUN = {page: [block for block in ALL if block.page == page and block.is_run] for page in PAGES}


def label(page: Path) -> str:
    return page.name


def test_every_block_that_is_not_run_says_why() -> None:
    assert len(ALL) > 30
    assert sum(block.is_run for block in ALL) >= 10
    for block in ALL:
        if block.run_by:
            assert (CHECKOUT / block.run_by).is_file(), f"{block.page.name}:{block.line}"


@pytest.mark.slow
@pytest.mark.xdist_group("printed")  # one at a time: some ports are what the page says
@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", [page for page in PAGES if RUN[page]], ids=label)
def test_the_blocks_of_a_page_run_as_printed(page: Path, tmp_path: Path) -> None:
    prepare(tmp_path)
    room = cv2.cvtColor(generate_room(3, 512), cv2.COLOR_RGB2BGR)
    cv2.imwrite(str(tmp_path / "my-room.jpg"), np.ascontiguousarray(room))
    with FakeRobot() as robot:
        for block in RUN[page]:
            run(block, tmp_path, robot.address)


def prepare(folder: Path) -> None:
    """A folder with the shipped models, and the program."""
    (folder / "models").symlink_to(CHECKOUT / "models")
    programs = folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "workstation").write_text(PROGRAM.format(python=sys.executable))
    (programs / "workstation").chmod(0o755)


def run(block: Block, folder: Path, robot: str) -> None:
    environment = {name: v for name, v in os.environ.items() if not name.startswith("MBOT_")}
    environment |= {
        "HOME": str(folder),
        "XDG_CONFIG_HOME": str(folder / ".config"),
        "PATH": f"{folder / '.venv' / 'bin'}:/usr/bin:/bin",
        "SHORTER": ";".join(f"{name}={options}" for name, options in block.shorter.items()),
        "MBOT_ROBOT": robot,
    }
    done = subprocess.run(
        ["bash", "-ec", block.script],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=800,
        check=False,
    )
    where = f"{block.page.name}:{block.line}"
    assert done.returncode == 0, f"{where}\n{block.script}\n{done.stdout}"
    assert "Traceback" not in done.stdout, f"{where}\n{done.stdout}"
