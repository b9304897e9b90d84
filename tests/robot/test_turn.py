import logging
import threading

import pytest

from mbot_agent.models import turn as turn_module
from mbot_agent.models.turn import Turn

from .lock_watch import LockWatch


def test_what_is_said_in_a_turn_is_logged_after_it(
    lock_watch: LockWatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    turn = Turn()
    with turn:
        turn.say(logging.INFO, "model %s", "red")
        turn.say(logging.ERROR, "gone")
        assert caplog.messages == []
    assert caplog.messages == ["model red", "gone"]
    turn.say(logging.INFO, "at once")
    assert caplog.messages[-1] == "at once"


def test_it_is_logged_too_if_the_turn_ends_in_an_error(caplog: pytest.LogCaptureFixture) -> None:
    turn = Turn()

    def fail() -> None:
        with turn:
            turn.say(logging.ERROR, "why")
            raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        fail()
    assert caplog.messages == ["why"]
    with turn:  # it is free again
        pass


def test_one_thread_at_a_time() -> None:
    turn, second = Turn(), threading.Event()

    def wait() -> None:
        with turn:
            second.set()

    with turn:
        waiting = threading.Thread(target=wait)
        waiting.start()
        assert not turn.taken_within(0.05)
        assert not second.is_set()
    assert second.wait(5)
    waiting.join()


def test_the_watch_over_all_tests_notices_a_line_under_a_lock(lock_watch: LockWatch) -> None:
    turn = Turn()
    with turn:
        turn_module.log.error("too early")
    (found,) = lock_watch.under_a_lock
    assert "too early" in found
    lock_watch.under_a_lock.clear()
