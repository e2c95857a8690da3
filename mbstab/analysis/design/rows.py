"""Linear inequalities that hold to first order, and the best point that they allow."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.design.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class Rows:
    """Inequalities A x + B y <= b + s·e for parameters x in the unit cube, unknowns y of the goal and a slack e >= 0.

    The sum of y is as large as possible.

    Attributes
    ----------
    A : ndarray, shape (rows, n)
    B : ndarray, shape (rows, k)
    b : ndarray, shape (rows,)
    slack : ndarray, shape (rows,)
        s, 0 or 1.
    """

    A: Array
    B: Array
    b: Array
    slack: Array

    @staticmethod
    def joined(parts: list[Rows]) -> Rows:
        """Return the rows of several parts."""
        return Rows(
            np.vstack([x.A for x in parts]),
            np.vstack([x.B for x in parts]),
            np.concatenate([x.b for x in parts]),
            np.concatenate([x.slack for x in parts]),
        )

    @staticmethod
    def of(A: Array, B: Array, b: Array, x: Array) -> Rows:
        """Return A·(x' − x) + B y <= b as rows of x'."""
        A = np.atleast_2d(A)
        return Rows(A, np.broadcast_to(B, (len(A), np.shape(B)[-1])), b + A @ x, np.zeros(len(A)))

    def best(self, x: Array, reach: float, limits: Array) -> Array | None:
        """Return the best point of the cube within a reach of x; None if there is none.

        Parameters
        ----------
        limits : ndarray, shape (k, 2)
            Bounds of y.
        """
        from scipy.optimize import linprog

        n, k = self.A.shape[1], self.B.shape[1]
        cost = np.concatenate([np.zeros(n), -np.ones(k), [TOLERANCES.cost_of_slack]])
        matrix = np.hstack([self.A, self.B, -self.slack[:, None]])
        bounds = [*zip(np.maximum(x - reach, 0.0), np.minimum(x + reach, 1.0), strict=True), *limits, (0.0, None)]
        # Rows of like size.
        size = np.maximum(np.max(np.abs(matrix), axis=1), 1e-300)
        found = linprog(cost, matrix / size[:, None], self.b / size, bounds=bounds, method="highs")
        return np.clip(found.x[:n], 0.0, 1.0) if found.x is not None else None
