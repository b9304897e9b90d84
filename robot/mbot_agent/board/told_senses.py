"""What a board has told of its senses: how new that is, how often there was an edge."""

import time

from mbot_agent.configuration import SensesSettings
from mbot_agent.faults import Fault, Notice
from mbot_protocol.drive.senses import Senses

SILENT_AFTER_NS = 500_000_000
"""Ten times as long as between two tellings."""

LOW_SUPPLY_V = 4.4
"""The ATmega328P is made for 16 MHz from 4.5 V on (data sheet, 28.3); the measurement errs by the
reference's 10 %, so this comes before most boards brown out, and on some without cause."""


class ToldSenses:
    """Of one board; the motor thread tells, any thread may look.

    Attributes:
        latest: None: it tells nothing.
        edges: how often it has begun to hold back for want of floor since the daemon's start.

    """

    def __init__(self, settings: SensesSettings) -> None:
        self._wanted = settings.are_read
        self._told_ns: int  # where it is watched
        self.edges = 0
        self.lost()

    def connected(self, firmware: str, *, watched: bool) -> None:
        """A board has answered; whether it is going to tell."""
        self._firmware, self._watched = firmware, watched
        self._told_ns = time.monotonic_ns()

    def take(self, senses: Senses | None) -> None:
        """What it told last, whether or not that is new."""
        before = self.latest
        if senses is before:
            return
        self._told_ns = time.monotonic_ns()
        was_at_edge = before is not None and before.at_edge
        if senses is not None and senses.at_edge and not was_at_edge:
            self.edges += 1
        self.latest = senses

    def lost(self) -> None:
        """No board any more, or none yet."""
        self._firmware, self._watched = "", False
        self.latest: Senses | None = None

    @property
    def fault(self) -> Fault | None:
        """A board that was to tell and has stopped telling."""
        if not self._watched:
            return None
        silent_ns = time.monotonic_ns() - self._told_ns
        if silent_ns < SILENT_AFTER_NS:
            return None
        return Fault(
            "senses-silent",
            f"the board has told nothing of its sensors for {silent_ns / 1e9:.1f} s; switch it off "
            "and on, or set [senses] edge and distance_m off",
        )

    @property
    def notices(self) -> tuple[Notice, ...]:
        """What is worth knowing and holds up nobody."""
        found: list[Notice] = []
        if self._wanted and self._firmware and not self._watched:
            found.append(
                Notice(
                    "senses-off",
                    f"the board's firmware ({self._firmware}) does not tell of its sensors: "
                    "[senses] is without effect; flash mbot-deadman 3 (`workstation flash`)",
                )
            )
        supply_v = self.latest.supply_v if self.latest is not None else None
        if supply_v is not None and supply_v < LOW_SUPPLY_V:
            found.append(
                Notice(
                    "supply-low",
                    f"the board's processor has {supply_v:.1f} V: charge the battery before it "
                    "resets in mid-drive",
                )
            )
        return tuple(found)
