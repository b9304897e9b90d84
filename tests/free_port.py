"""Ports on loopback that nobody listens on, never the same one twice."""

import os
import random
import socket

LOCALHOST = "127.0.0.1"
FIRST, LAST = 20_000, 32_000
"""Below the ports that Linux gives to outgoing connections (32768 and up), so that none takes it
before the test listens there."""
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 10
_SHARE = (LAST - FIRST) // 10
_mine = list(range(FIRST + _worker * _SHARE, FIRST + (_worker + 1) * _SHARE))
random.SystemRandom().shuffle(_mine)


def free_port() -> int:
    """Return a port of this test process that is free now and was not given out before."""
    while True:
        with socket.socket() as probe:
            port = _mine.pop()
            try:
                probe.bind((LOCALHOST, port))
            except OSError:
                continue
            return port
