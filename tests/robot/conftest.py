"""Fakes shared by the robot's tests."""

from collections.abc import Iterator

import pytest

from .fake_board import FakeBoard


@pytest.fixture
def board() -> Iterator[FakeBoard]:
    with FakeBoard() as fake:
        yield fake
