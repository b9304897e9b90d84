from collections.abc import Iterator

import pytest

from ..workstation.fake_robot import FakeRobot


@pytest.fixture
def fake() -> Iterator[FakeRobot]:
    with FakeRobot() as fake:
        yield fake
