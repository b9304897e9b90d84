"""Does the stop service still answer? The daemon asks it as anybody would, twice a second."""

import logging
import threading
import time
from collections.abc import Callable
from typing import Self

log = logging.getLogger(__name__)

ASK_EVERY_S = 0.4
TIMEOUT_S = 0.5


class StopProbe:
    """Asks on a thread of its own. A context manager.

    Attributes:
        answered_ns: when the last answer came, monotonic.

    """

    def __init__(self, ask: Callable[[float], bool]) -> None:
        """`ask` says within the given seconds whether the service has answered; it may raise."""
        self._ask = ask
        self.answered_ns = time.monotonic_ns()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="stop probe", daemon=True)

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
            log.debug("the stop service was not asked: %s", error)  # then it counts as silent

    def _run(self) -> None:
        while not self._closing.wait(ASK_EVERY_S):
            self.ask()
