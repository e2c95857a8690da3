"""Eigenvalues at many values of parameters, and their derivatives at one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.design.moving import Moving
from mbstab.analysis.spectrum.sensitivity import moved_matrix
from mbstab.analysis.sweep.batched_spectra import Evaluator
from mbstab.analysis.verdict.rule import AXIS
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, NumericalError, UsageError
from mbstab.model.parameters import bound, settings_in_si
from mbstab.model.schema import Model
from mbstab.records import dataclass

Place = Mapping[str, float]


@dataclass(frozen=True)
class Local:
    """Eigenvalues at a place, and how they move.

    Attributes
    ----------
    values : ndarray of complex, shape (r,)
        All that are not neutral, pairs with both of their members (1/s).
    errors : ndarray, shape (r,)
        Their error bounds (1/s).
    moving : Moving or None
        The matrix of which they are the eigenvalues; None where it has no derivatives.
    """

    values: Complex
    errors: Array
    moving: Moving | None

    def partner(self, i: int) -> int:
        """Return the eigenvalue next to another one."""
        gaps = np.abs(self.values - self.values[i])
        gaps[i] = np.inf
        return int(np.argmin(gaps))

    def is_multiple(self, i: int) -> bool:
        """Return whether an eigenvalue is not known to be a simple one."""
        near = np.abs(self.values - self.values[i]) <= self.errors + self.errors[i]
        return bool(np.sum(near) > 1 or not np.isfinite(self.errors[i]))


class Plant:
    """A model whose parameters vary.

    Parameters
    ----------
    model : Model
    start : mapping
        Values in SI at which it is asked first.

    Attributes
    ----------
    count : int
        Number of eigenvalues that are not neutral there.
    size : float
        The largest of them (1/s).
    start : Local
        All of them there.

    Raises
    ------
    MbstabError
        If there is no answer there.
    """

    def __init__(self, model: Model, start: Place) -> None:
        self.model, self.evaluator = model, Evaluator(model)
        self.start = self.local(start, tuple(start))
        values = self.start.values
        self.count, self.size = len(values), float(np.max(np.abs(values), initial=0.0))
        self.evaluator.patterns += self.evaluator.patterns_at(start)
        found = self.evaluator.near({name: np.array([x]) for name, x in start.items()}, self.count)
        for reason in found.problems.values():
            raise NumericalError(f"there are no eigenvalues to improve at the start: {reason}")

    def values(self, points: Mapping[str, Array]) -> Complex:
        """Return the eigenvalues that are not neutral, shape (points, r); nan where there is no answer.

        Those that a structure holds on the imaginary axis have no real part.
        """
        found = self.evaluator.near(points, self.count)
        if found.values.shape[1] == self.count:
            return np.where(found.sides == AXIS, 1j * found.values.imag, found.values)
        return np.full((len(found.values), self.count), np.nan + 0j)

    def local(self, place: Place, names: Sequence[str]) -> Local:
        """Return the eigenvalues at a place and their derivatives by some parameters.

        Raises
        ------
        UsageError
            If the reference cannot move with one of them.
        MbstabError
            As `mbstab.analysis.spectrum.sensitivity.moved_matrix`.
        """
        found = moved_matrix(bound(self.model, settings_in_si(place)))
        for name in names:
            if name in found.missing:
                raise UsageError(f"{name} cannot be varied: {found.missing[name]}")
        judged = [e for e in found.result.eigenvalues if not e.exact]
        columns = [found.parameters.index(name) for name in names]
        moving = None if found.slopes is None else Moving(found.A, found.slopes[columns])
        values, errors = [e.value for e in judged], [e.error_bound for e in judged]
        return Local(np.array(values, dtype=complex), np.array(errors), moving)

    def known(self, place: Place, names: Sequence[str]) -> Local | None:
        """Return the eigenvalues at a place and their derivatives, or None if there are none."""
        try:
            return self.local(place, names)
        except UsageError:
            raise
        except MbstabError:
            return None
