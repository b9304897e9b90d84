"""What the log says of the motors when a signal ends the daemon: what the board has said."""

import subprocess
import sys

import pytest

from mbot_agent.process.termination import THREAD_DIED

from ..ran import ran

PROGRAM = """
import logging, os, signal, threading
logging.basicConfig(format="%(message)s", level=logging.INFO)
from mbot_agent.process import termination
termination.block_signals()
closing = threading.Event()
termination.watch(lambda: {confirmed}, closing)
os.kill(os.getpid(), signal.SIGTERM)
print("closing" if closing.wait(5) else "goes on")
"""

FALLS_OVER = """
import logging, threading
logging.basicConfig(format="%(message)s", level=logging.INFO)
from mbot_agent.process import termination
def last_words(): print("last words", flush=True)
termination.end_with_any_thread({stop}, last_words)
threading.Thread(target=lambda: 1 / 0, name="a part", daemon=True).start()
threading.Event().wait(5)
"""


@pytest.mark.parametrize("confirmed", [True, False])
def test_motors_are_called_stopped_only_by_the_boards_word(confirmed: bool) -> None:
    program = PROGRAM.format(confirmed=confirmed)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ("SIGTERM: motors stopped" in done.stderr) is confirmed
    assert ("no board has confirmed" in done.stderr) is not confirmed
    assert done.stdout == "closing\n"


@pytest.mark.parametrize("stop", ["lambda: True", "lambda: 1 / 0"])
def test_an_exception_that_ends_any_thread_ends_the_process(stop: str) -> None:
    """Motors first; and whatever comes of that."""
    done = ran(sys.executable, "-c", FALLS_OVER.format(stop=stop))
    assert done.returncode == THREAD_DIED
    if stop == "lambda: True":
        assert "the thread 'a part' died: motors stopped, ending" in done.stderr
        assert "ZeroDivisionError" in done.stderr
        assert done.stdout == "last words\n"
