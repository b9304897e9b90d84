from collections.abc import Iterator

import pytest

from .fake_robot import FakeRobot


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    with FakeRobot() as fake:
        yield fake
