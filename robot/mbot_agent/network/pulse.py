"""Does the daemon still hear anybody? It asks itself as a workstation would, twice a second."""

import logging
import threading
import time
from collections.abc import Callable
from typing import Self

log = logging.getLogger(__name__)

ASK_EVERY_S = 0.4
TIMEOUT_S = 0.5


class Pulse:
    """Asks on a thread of its own. A context manager.

    Attributes:
        answered_ns: when the last answer came, monotonic.

    """

    def __init__(self, ask: Callable[[float], bool]) -> None:
        """`ask` says within the given seconds whether an answer came; it may raise."""
        self._ask = ask
        self.answered_ns = time.monotonic_ns()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pulse", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._closing.set()
        self._thread.join(timeout=TIMEOUT_S)

    def ask(self) -> None:
        """Ask once."""
        try:
            if self._ask(TIMEOUT_S):
                self.answered_ns = time.monotonic_ns()
        except Exception as error:
            log.debug("the daemon did not ask itself: %s", error)  # then it counts as silent

    def _run(self) -> None:
        while not self._closing.wait(ASK_EVERY_S):
            self.ask()
