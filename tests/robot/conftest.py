"""Fakes shared by the robot's tests, and one watch over all of them."""

import logging
from collections.abc import Iterator

import pytest

from .lock_watch import HELD, LockWatch, SpiedThreading, watched_modules


@pytest.fixture(autouse=True)
def lock_watch(monkeypatch: pytest.MonkeyPatch) -> Iterator[LockWatch]:
    """In every test here: nobody logs under a lock, for who reads the log may be slow."""
    HELD.depth = 0
    for module in watched_modules():
        monkeypatch.setattr(module, "threading", SpiedThreading())
    watch, logger = LockWatch(), logging.getLogger("mbot_agent")
    level = logger.level
    logger.setLevel(logging.DEBUG)
    logger.addHandler(watch)
    yield watch
    logger.removeHandler(watch)
    logger.setLevel(level)
    assert not watch.under_a_lock, "these lines were logged under a lock"
