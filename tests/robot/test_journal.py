import logging
import os
import threading
import time
from collections.abc import Iterator

import pytest

from mbot_agent.process.journal import BACKLOG, Journal


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    """A pipe to log into: reading end, writing end. The root logger is as before afterwards."""
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    reader, writer = os.pipe()
    yield reader, writer
    root.handlers[:] = handlers
    root.setLevel(level)
    os.close(reader)  # a thread that waits for the pipe is told so


def test_lines_come_in_their_order_with_their_level(pipe: tuple[int, int]) -> None:
    written = Journal(verbose=False, stream=pipe[1])
    logging.getLogger("x").info("one %d", 1)
    logging.getLogger("x").debug("not this one")
    written.say("as it is")
    written.drain(5)
    lines = os.read(pipe[0], 4096).decode().splitlines()
    assert [line.partition("INFO ")[2] or line for line in lines] == ["one 1", "as it is"]


def test_a_log_that_nobody_reads_blocks_nobody(pipe: tuple[int, int]) -> None:
    written = Journal(verbose=False, stream=pipe[1])
    began_s = time.monotonic()
    for number in range(4 * BACKLOG):
        logging.getLogger("x").info("%s %d", "x" * 100, number)
    assert time.monotonic() - began_s < 1.5
    began_s = time.monotonic()
    written.drain(0.2)
    assert time.monotonic() - began_s < 1.5


def test_what_was_dropped_is_counted(pipe: tuple[int, int]) -> None:
    written = Journal(verbose=False, stream=pipe[1])
    total = 4 * BACKLOG
    for number in range(total):
        logging.getLogger("x").info("%s line %d", "x" * 100, number)
    text: list[bytes] = []

    def read() -> None:
        while b"the last one" not in b"".join(text[-2:]):
            text.append(os.read(pipe[0], 65536))

    reading = threading.Thread(target=read)
    reading.start()
    written.drain(5)
    logging.getLogger("x").info("the last one")
    written.drain(5)
    reading.join(5)
    whole = b"".join(text).decode()
    dropped = [int(line[1:].split()[0]) for line in whole.splitlines() if "were dropped" in line]
    assert sum(dropped) + whole.count(" line ") == total
