"""Which tests are slow: they run in `make test-all` and in CI, not in `make test`. And a robot's
board and daemon."""

import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from .robot.fake_board import FakeBoard

if TYPE_CHECKING:
    from .end_to_end.processes import Daemon

settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")
"""How long an example takes says how busy the machine is."""

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts what it puts in the background deaf to Ctrl-C, and children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)

SLOW_FOLDERS = ("end_to_end", "reliability", "firmware")
"""Real programs, real time, real faults."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        if item.path.relative_to(here).parts[0] in SLOW_FOLDERS:
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def board() -> Iterator[FakeBoard]:
    with FakeBoard() as fake:
        yield fake


@pytest.fixture
def daemon(tmp_path: Path, board: FakeBoard) -> "Daemon":
    from .end_to_end.processes import Daemon

    return Daemon(tmp_path, board.path)
