"""Which model is active, which ones have proven themselves, and which one to go back to.

The content of `active.json`, as a value; each change gives a new one, which one rename makes true.
"""

from collections.abc import Callable

import msgspec

from mbot_agent.faults import Notice

MOST_STARTS = 2
"""Starts a model has to prove itself that crashes the daemon; the next one goes without it."""

MOST_STARTS_PROVEN = 5
WITHIN_S = 600.0
"""A model that has proven itself goes after so many crashes in so short a time: the world, the
libraries or the memory may have changed since it did."""

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
        proven_starts: when the daemon was started with the active model, proven, and did not end in
            order: UNIX times, the latest last.
        rollback: the last one, until a person makes a model active.

    """

    active: str = ""
    previous: str = ""
    proven: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    starts: dict[str, int] = {}
    proven_starts: tuple[float, ...] = ()
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
            proven_starts=(),
            rollback=None,
        )

    def started(self, sha256: str, now_s: float) -> "Activation":
        """The daemon is about to load this model; `now_s` is UNIX time."""
        if sha256 in self.proven:
            lately = tuple(at_s for at_s in self.proven_starts if now_s - at_s <= WITHIN_S)
            return msgspec.structs.replace(self, proven_starts=(*lately, now_s))
        starts = self.starts | {sha256: self.starts.get(sha256, 0) + 1}
        return msgspec.structs.replace(self, starts=starts)

    def survived(self) -> "Activation":
        """The daemon did not crash: the starts so far are held against no model."""
        return msgspec.structs.replace(self, starts={}, proven_starts=())

    def proved(self, sha256: str) -> "Activation":
        """This model has decided well for long enough."""
        proven = (*_without(self.proven, sha256), sha256)[-REMEMBERED:]
        return msgspec.structs.replace(self, proven=proven, starts={}, proven_starts=())

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
            proven_starts=(),
            rollback=Rollback(sha256, successor, reason),
        )

    def crashes(self, sha256: str, now_s: float) -> str:
        """In words, that this model has had its starts; empty if it has not."""
        if sha256 in self.proven:
            lately = [at_s for at_s in self.proven_starts if now_s - at_s <= WITHIN_S]
            if sha256 == self.active and len(lately) >= MOST_STARTS_PROVEN:
                return f"the daemon crashed {len(lately)} times within {WITHIN_S / 60:.0f} minutes"
        elif self.starts.get(sha256, 0) >= MOST_STARTS:
            return f"the daemon crashed at its last {MOST_STARTS} starts with it"
        return ""

    def notice(
        self, name_of: Callable[[str], str], now_s: float, *, has_model: bool, unusable: str
    ) -> Notice | None:
        """What a person should know of the models, though the robot drives.

        Args:
            name_of: a stored model's name by its digest; empty if unknown.
            now_s: UNIX time.
            has_model: whether there is one in use.
            unusable: why the active one could not be loaded at the daemon's start; empty if it was.

        """

        def named(sha256: str) -> str:
            return f"{name_of(sha256) or 'model'} {sha256[:12]}"

        if (rollback := self.rollback) is not None:
            given_up, successor = named(rollback.sha256), named(rollback.successor)
            text = f"{given_up} was rolled back to {successor}: {rollback.reason}"
            return Notice("model-rolled-back", text)
        if has_model:
            return None
        if crashes := self.crashes(self.active, now_s):
            text = f"{named(self.active)} is the only one, and {crashes}: push another one"
            return Notice("model-left-out", text)
        if unusable:
            text = f"{named(self.active)} cannot be used: {unusable}"
            return Notice("model-unusable", text)
        return None

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
