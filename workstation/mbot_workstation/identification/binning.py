"""Averages over short bins of samples; how far single samples scatter is found, far ones fade."""

import numpy as np

from mbot_workstation.recordings.track import Array

BIN_S = 0.05
"""In which the wheels' speed does not change much; 4 or 5 samples at 90 Hz."""

FAR = 2.0
"""From this many standard deviations about its bin on, a sample counts less."""

ROBUST = 1.4826
"""Standard deviation of normal numbers by their median distance from the middle."""


class Binning:
    """Samples in bins.

    Attributes:
        bins: how many bins there are.

    """

    def __init__(self, time_s: Array) -> None:
        """Sort rising times into bins."""
        _, self._first = np.unique(np.floor(time_s / BIN_S), return_index=True)
        self._count = np.diff(self._first, append=time_s.size)
        self._bin = np.repeat(np.arange(self._first.size), self._count)
        self.bins: int = self._first.size

    def weigh(self, values: Array) -> tuple[Array, float]:
        """Weigh samples by how far they are from their bin's middle.

        Args:
            values: one or two coordinates of each sample, shape (c, n).

        Returns:
            The weights, shape (n,), and the standard deviation of a single coordinate.

        """
        off = values - np.array([self._middle(row) for row in values])[:, self._bin]
        # The middle sample of a bin is off by nothing and must not count; the others are off the
        # middle about as far as off the truth (4 of 5 samples: 1.01 times, simulated).
        others = np.abs(off)[off != 0]
        deviation = ROBUST * float(np.median(others)) if others.size else 0.0
        far = np.sqrt((off**2).mean(axis=0)) / max(FAR * deviation, 1e-9)
        return 1 / np.maximum(1, far) ** 2, deviation

    def sums(self, values: Array) -> Array:
        """Of samples (..., n) in each bin, shape (..., bins)."""
        return np.add.reduceat(values, self._first, axis=-1)

    def _middle(self, row: Array) -> Array:
        order = np.lexsort((row, self._bin))
        return row[order][self._first + self._count // 2]
