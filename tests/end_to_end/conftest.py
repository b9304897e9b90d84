"""A board for the real daemon to drive."""

from collections.abc import Iterator

import pytest

from ..robot.fake_board import FakeBoard


@pytest.fixture
def board() -> Iterator[FakeBoard]:
    with FakeBoard() as fake:
        yield fake
