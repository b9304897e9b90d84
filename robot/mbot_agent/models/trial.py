"""Whether a model does well: the control loop counts, the model keeper draws the conclusions."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

FAILURES_UNTIL_VERDICT = 3
"""Inference errors in a row until a model counts as broken."""


class Finding(Enum):
    """What a trial has come to."""

    PROVEN = "proven"
    """Enough clean decisions in a row."""

    SURVIVED = "survived"
    """As many ticks without being asked: the daemon lives, but knows nothing of the model yet."""

    BROKEN = "broken"
    """Failed FAILURES_UNTIL_VERDICT times in a row."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A finding about one model, and for a broken one the last reason."""

    sha256: str
    finding: Finding
    reason: str = ""


class Trial:
    """Counts for one model, from its first decision on. Used by the control loop's thread only."""

    def __init__(self, sha256: str, clean_decisions: int, tell: Callable[[Verdict], None]) -> None:
        """Begin.

        Args:
            sha256: the model.
            clean_decisions: needed to prove it; 0: it is proven already.
            tell: hears each verdict; must return at once.

        """
        self._sha256 = sha256
        self._needed = clean_decisions
        self._tell = tell
        self._clean = 0
        self._idle = 0
        self._failures = 0

    @property
    def is_open(self) -> bool:
        """The model has yet to prove itself: it is asked even when nobody needs the answer."""
        return self._clean < self._needed

    @property
    def is_broken(self) -> bool:
        """It has failed so often that it should not be asked again."""
        return self._failures >= FAILURES_UNTIL_VERDICT

    def clean(self) -> None:
        """It has decided well and in time."""
        self._failures = 0
        if self.is_open:
            self._clean += 1
            if not self.is_open:
                self._tell(Verdict(self._sha256, Finding.PROVEN))

    def idle(self) -> None:
        """A tick has passed in which it was not asked, or was too slow to count."""
        if self.is_open:
            self._idle += 1
            if self._idle == self._needed:
                self._tell(Verdict(self._sha256, Finding.SURVIVED))

    def failed(self, reason: str) -> None:
        """It has raised an error or answered nonsense."""
        self._failures += 1
        if self.is_open:
            self._clean = 0
        if self._failures == FAILURES_UNTIL_VERDICT:
            self._tell(Verdict(self._sha256, Finding.BROKEN, reason))
