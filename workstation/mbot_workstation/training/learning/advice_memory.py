"""Sequences and what the guide said to them, kept to be rehearsed.

A decision costs a millisecond to simulate and a twentieth of that to learn from: PPO must forget
it after an update, but advice stays true, so it is learned from many times.
"""

from dataclasses import fields

import numpy as np

from mbot_workstation.training.learning.sequences import Sequences

BURN_IN = 8
"""Decisions at the beginning of a remembered sequence from which nothing is learned: what the
policy remembered there is in the terms of weights that have changed since."""


class AdviceMemory:
    """The newest sequences, up to about `capacity` decisions, 12 kB each."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._kept: list[Sequences] = []

    def __len__(self) -> int:
        return sum(one.decisions for one in self._kept)

    def add(self, sequences: Sequences) -> None:
        """Remember these, without what only PPO wants; the oldest give way."""
        plain = {field.name: getattr(sequences, field.name) for field in fields(Sequences)}
        self._kept.append(Sequences(**plain))
        while len(self._kept) > 1 and len(self) > self._capacity:
            self._kept.pop(0)

    def draw(self, decisions: int) -> Sequences:
        """Random sequences of about so many decisions; numpy's global generator draws.

        Advice for the decisions of the burn-in is unknown in them.
        """
        length = self._kept[0].forgot.shape[0]
        sizes = np.array([one.forgot.shape[1] for one in self._kept])
        ends = np.cumsum(sizes)
        chosen = np.random.randint(ends[-1], size=max(1, decisions // length))
        where = np.searchsorted(ends, chosen, side="right")
        columns = chosen - (ends - sizes)[where]

        def gathered(name: str) -> np.ndarray:
            axis = 0 if name == "state" else 1
            drawn = [
                np.take(getattr(self._kept[place], name), column, axis=axis)
                for place, column in zip(where, columns, strict=True)
            ]
            return np.stack(drawn, axis=axis)

        drawn = {field.name: gathered(field.name) for field in fields(Sequences)}
        if length > BURN_IN and drawn["state"].shape[1]:
            drawn["advice"][:BURN_IN] = np.nan
        return Sequences(**drawn)
