"""Which model is active, which ones have proven themselves, and which one to go back to.

The content of `active.json`, as a value; each change gives a new one, which one rename makes true.
"""

import msgspec

MOST_STARTS = 2
"""Starts a model has to prove itself that crashes the daemon; the next one goes without it."""

CRASHED = f"the daemon crashed at its last {MOST_STARTS} starts with it"
"""The reason for such a roll-back."""

REMEMBERED = 100
"""As many models as a store may keep (models.keep)."""


class Rollback(msgspec.Struct, frozen=True):
    """A model the daemon has given up by itself, the one it went back to, and why."""

    sha256: str
    successor: str
    reason: str


class Activation(msgspec.Struct, frozen=True):
    """Models by digest; empty: none.

    Attributes:
        active: the one to load.
        previous: the one that was active before; a person's roll-back goes there.
        proven: those that have decided well for a while, the latest last.
        rejected: those the daemon has given up; only a person makes one active again.
        starts: of the daemon with a model that had yet to prove itself, which ended badly.
        rollback: the last one, until a person makes a model active.

    """

    active: str = ""
    previous: str = ""
    proven: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    starts: dict[str, int] = {}
    rollback: Rollback | None = None

    def activated(self, sha256: str, in_use: str) -> "Activation":
        """A person wants this model, whatever was held against it, after the one in use."""
        previous = self.previous if in_use in ("", sha256) else in_use
        return msgspec.structs.replace(
            self,
            active=sha256,
            previous="" if previous == sha256 else previous,
            rejected=_without(self.rejected, sha256),
            starts={},
            rollback=None,
        )

    def started(self, sha256: str) -> "Activation":
        """The daemon is about to load this model, which has yet to prove itself."""
        starts = self.starts | {sha256: self.starts.get(sha256, 0) + 1}
        return msgspec.structs.replace(self, starts=starts)

    def survived(self) -> "Activation":
        """The daemon did not crash: the starts so far are held against no model."""
        return msgspec.structs.replace(self, starts={})

    def proved(self, sha256: str) -> "Activation":
        """This model has decided well for long enough."""
        proven = (*_without(self.proven, sha256), sha256)[-REMEMBERED:]
        return msgspec.structs.replace(self, proven=proven, starts={})

    def rolled_back(self, sha256: str, successor: str, reason: str) -> "Activation":
        """The daemon gives `sha256` up and goes back to `successor`."""
        keep_previous = self.previous not in (sha256, successor)
        return msgspec.structs.replace(
            self,
            active=successor,
            previous=self.previous if keep_previous else "",
            proven=_without(self.proven, sha256),
            rejected=(*_without(self.rejected, sha256), sha256)[-REMEMBERED:],
            starts={},
            rollback=Rollback(sha256, successor, reason),
        )

    def has_crashed_the_daemon(self, sha256: str) -> bool:
        """Whether this model has had its starts."""
        return self.starts.get(sha256, 0) >= MOST_STARTS

    def successors(self, sha256: str) -> tuple[str, ...]:
        """What to go back to from this model, best first: the previous one if it has proven
        itself, then whatever else has, the latest first, then the previous one after all.
        """
        proven = [one for one in reversed(self.proven) if one != self.previous]
        if self.previous in self.proven:
            order = [self.previous, *proven]
        else:
            order = [*proven, self.previous]
        barred = {"", sha256, *self.rejected}
        return tuple(one for one in order if one not in barred)


def _without(digests: tuple[str, ...], sha256: str) -> tuple[str, ...]:
    return tuple(one for one in digests if one != sha256)
