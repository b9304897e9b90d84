"""Pictures and what the guide said to them, kept to be rehearsed.

A decision costs a millisecond to simulate and a twentieth of that to learn from: PPO must forget
it after an update, but advice stays true, so it is learned from many times.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A batch: pictures, shape (n, 64, 64, 3), uint8, and advice, shape (n, 2), all known."""

    pictures: NDArray[np.uint8]
    advice: NDArray[np.float32]


class AdviceMemory:
    """The newest `capacity` pictures with known advice; 12 kB each."""

    def __init__(self, capacity: int, picture_shape: tuple[int, ...]) -> None:
        self._pictures = np.empty((capacity, *picture_shape), np.uint8)
        self._advice = np.empty((capacity, 2), np.float32)
        self._next = 0
        self._known = 0

    def __len__(self) -> int:
        return self._known

    def add(self, pictures: NDArray[np.uint8], advice: NDArray[np.float32]) -> None:
        """Remember those whose advice is known; the oldest give way.

        Args:
            pictures: shape (n, 64, 64, 3).
            advice: shape (n, 2); not a number where there is none.

        """
        known = np.isfinite(advice).all(axis=1)
        pictures, advice = pictures[known], advice[known]
        capacity = len(self._advice)
        places = (self._next + np.arange(len(advice))) % capacity
        self._pictures[places] = pictures
        self._advice[places] = advice
        self._next = (self._next + len(advice)) % capacity
        self._known = min(self._known + len(advice), capacity)

    def draw(self, size: int) -> Rehearsal:
        """A random batch; numpy's global generator draws, as it does for PPO's batches."""
        chosen = np.random.randint(self._known, size=size)
        return Rehearsal(self._pictures[chosen], self._advice[chosen])
