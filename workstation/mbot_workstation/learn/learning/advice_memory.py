"""Sequences and what the guide said to them, kept to be rehearsed.

A decision costs a millisecond to simulate and a twentieth of that to learn from: PPO must forget
it after an update, but advice stays true, so it is learned from many times.
"""

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.learn.learning.sequences import Sequences

BURN_IN = 8
"""Decisions at the beginning of a remembered sequence from which nothing is learned: what the
policy remembered there is in the terms of weights that have changed since."""

GOES_ON = 0.5
"""Mean of both wheels beyond which a robot is advised to drive on, not to search: to what it
remembers where the picture does not show it. The guide drives on at a mean of 1 and searches at one
near 0."""


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
        where, columns = self._drawn(max(1, decisions // length))

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

    def draw_alone(self, decisions: int) -> Sequences:
        """Random decisions, each a sequence of length 1 with an empty memory; numpy draws likewise.

        One blurred picture does not tell which way the robot turned. Who searches turns right, so
        that what an empty memory sees on the right has nearly always been turned to: it took it to
        be ahead by now, and after a turn to the left drove past it. So every other picture that
        shows an object is mirrored.
        """
        where, columns = self._drawn(decisions)
        moments = np.random.randint(self._kept[0].forgot.shape[0], size=decisions)
        mirrored = np.random.random(decisions) < 0.5
        pictures, advice = [], []
        for place, moment, column, mirror in zip(where, moments, columns, mirrored, strict=True):
            kept = self._kept[place]
            picture, wheels = kept.seen[moment, column], kept.advice[moment, column]
            if kept.shows[moment, column]:
                step = -1 if mirror else 1
                picture, wheels = picture[:, ::step], wheels[::step]
            elif wheels.mean() > GOES_ON:
                wheels = np.full_like(wheels, np.nan)
            pictures.append(picture)
            advice.append(wheels)
        return Sequences(
            seen=np.stack(pictures)[None],
            previous_actions=np.zeros((1, decisions, 2), np.float32),
            forgot=np.ones((1, decisions), np.float32),
            state=np.zeros((decisions, self._kept[0].state.shape[1]), np.float32),
            advice=np.stack(advice)[None],
            shows=np.ones((1, decisions), np.bool_),
        )

    def _drawn(self, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Which of the kept ones, and which of their columns; shapes (count,)."""
        sizes = np.array([one.forgot.shape[1] for one in self._kept])
        ends = np.cumsum(sizes)
        chosen = np.random.randint(ends[-1], size=count)
        where = np.searchsorted(ends, chosen, side="right")
        return where, chosen - (ends - sizes)[where]
