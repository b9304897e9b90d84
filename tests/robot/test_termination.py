"""What the log says of the motors when a signal ends the daemon: what the board has said."""

import subprocess
import sys

import pytest

PROGRAM = """
import logging, os, signal, threading
logging.basicConfig(format="%(message)s", level=logging.INFO)
from mbot_agent.process import termination
termination.block_signals()
closing = threading.Event()
termination.watch(lambda: {confirmed}, closing)
os.kill(os.getpid(), signal.SIGTERM)
closing.wait(5)
"""


@pytest.mark.parametrize("confirmed", [True, False])
def test_motors_are_called_stopped_only_by_the_boards_word(confirmed: bool) -> None:
    program = PROGRAM.format(confirmed=confirmed)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert ("SIGTERM: motors stopped" in done.stderr) is confirmed
    assert ("no board has confirmed" in done.stderr) is not confirmed
