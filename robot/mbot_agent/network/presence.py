"""Is a workstation still there? For robots that shall not drive alone (control.on_lost_link)."""

import logging
import threading
import time
from collections.abc import Callable
from typing import Self

from mbot_agent.configuration import Control
from mbot_agent.faults import Fault

log = logging.getLogger(__name__)

LOOK_EVERY_S = 0.5


class Presence:
    """Looks for workstations on a thread of its own. A context manager; idle unless asked for.

    A workstation shows itself by a token that Zenoh withdraws when the link has been silent for
    2 s (its lease), so a robot stops after that and `lost_link_after_s`.
    """

    def __init__(
        self,
        control: Control,
        look: Callable[[float], bool],
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """`look` says within the given seconds whether anybody is there; it may raise."""
        self._needed = control.on_lost_link == "stop"
        self._after_s = control.lost_link_after_s
        self._look = look
        self._monotonic = monotonic
        self._heard_s = monotonic()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="presence", daemon=True)

    def __enter__(self) -> Self:
        if self._needed:
            self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._closing.set()
        if self._needed:
            self._thread.join(timeout=1.0)

    def heard(self) -> None:
        """Somebody has just sent a command: he is there, whether or not his token is seen yet."""
        self._heard_s = self._monotonic()

    @property
    def fault(self) -> Fault | None:
        """The reason not to drive on alone; any thread may ask."""
        silence_s = self._monotonic() - self._heard_s
        if not self._needed or silence_s < self._after_s:
            return None
        return Fault(
            "link-lost",
            f"no workstation has been there for {self._after_s:g} s and more: look at the network, "
            "keep `workstation telemetry` open, or set control.on_lost_link",
        )

    def look(self) -> None:
        """Look once."""
        try:
            if self._look(LOOK_EVERY_S):
                self.heard()
        except Exception as error:
            log.debug("no look at the workstations: %s", error)  # then the link counts as lost

    def _run(self) -> None:
        while not self._closing.wait(LOOK_EVERY_S):
            self.look()
