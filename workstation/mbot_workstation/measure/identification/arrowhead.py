"""Projection onto what a maneuver's nuisance parameters can't explain.

Their Jacobian A = [diag(A_1, ..., A_k), B] has a block of columns a run, and columns B that runs
share, above their prior: an arrowhead matrix. With Q_i from A_i = Q_i R_i, and Q from
(I - diag(Q_i Q_i^T)) B = Q R, the matrix [diag(Q_i), Q] is an orthonormal basis of A's columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.linalg import solve_triangular

from mbot_workstation.measure.tracks.track import Array


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """One run's rows: Q_i, R_i and Q_i^T B_i."""

    rows: slice
    basis: Array
    triangle: Array
    shared: Array


@dataclass(frozen=True, slots=True, eq=False)
class Arrowhead:
    """The columns of one maneuver, as an orthonormal basis."""

    blocks: tuple[_Block, ...]
    basis: Array
    triangle: Array

    @classmethod
    def of(cls, runs: Sequence[tuple[Array, Array]], prior: Array) -> Self:
        """Eliminate the runs' own columns from the shared ones.

        Args:
            runs: of each its own columns and the shared ones', shapes (n, own) and (n, shared).
            prior: rows of the shared columns below all runs, shape (k, shared).

        """
        blocks: list[_Block] = []
        left: list[Array] = []
        row = 0
        for own, shared in runs:
            basis, triangle = np.linalg.qr(own)
            inside = basis.T @ shared
            blocks.append(_Block(slice(row, row + len(own)), basis, triangle, inside))
            left.append(shared - basis @ inside)
            row += len(own)
        return cls(tuple(blocks), *np.linalg.qr(np.concatenate([*left, prior])))

    def project_out(self, rows: Array) -> Array:
        """(I - A A^+) rows, which is (I - Q Q^T) (I - diag(Q_i Q_i^T)) rows.

        Shape (rows,) or (rows, n), as is what comes back.
        """
        left = rows.copy()
        for block in self.blocks:
            left[block.rows] -= block.basis @ (block.basis.T @ rows[block.rows])
        return left - self.basis @ (self.basis.T @ left)

    def solve(self, rows: Array) -> tuple[Array, Array]:
        """The least-squares coefficients A^+ rows, by back substitution: shared ones, then runs'.

        Args:
            rows: shape (rows,).

        Returns:
            Shapes (shared,) and (runs, own).

        """
        shared = solve_triangular(self.triangle, self.basis.T @ rows)
        own = [
            solve_triangular(one.triangle, one.basis.T @ rows[one.rows] - one.shared @ shared)
            for one in self.blocks
        ]
        return np.asarray(shared, np.float64), np.asarray(own, np.float64)
