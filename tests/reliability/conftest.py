"""A board and a daemon for it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ..end_to_end.processes import Daemon
from ..robot.fake_board import FakeBoard


@pytest.fixture
def board() -> Iterator[FakeBoard]:
    with FakeBoard() as fake:
        yield fake


@pytest.fixture
def daemon(tmp_path: Path, board: FakeBoard) -> Daemon:
    return Daemon(tmp_path, board.path)
