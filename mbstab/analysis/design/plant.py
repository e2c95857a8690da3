"""Eigenvalues at many values of parameters, and their derivatives at one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.spectrum.sensitivity import sensitivities
from mbstab.analysis.sweep.batched_spectra import Evaluator
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
    slopes : ndarray of complex, shape (r, parameters)
        Their derivatives in 1/s per SI unit; nan for those that are not known to be simple.
    errors : ndarray, shape (r,)
        Their error bounds (1/s).
    """

    values: Complex
    slopes: Complex
    errors: Array

    def partner(self, i: int) -> int:
        """Return the eigenvalue next to another one."""
        gaps = np.abs(self.values - self.values[i])
        gaps[i] = np.inf
        return int(np.argmin(gaps))

    @property
    def upper(self) -> Index:
        """Numbers of the eigenvalues with derivatives, of pairs one member."""
        return np.flatnonzero((self.values.imag >= 0.0) & ~np.isnan(self.slopes).any(axis=1))


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
        """Return the eigenvalues that are not neutral, shape (points, r); nan where there is no answer."""
        found = self.evaluator.near(points, self.count).values
        if found.shape[1] == self.count:
            return found
        return np.full((len(found), self.count), np.nan + 0j)

    def local(self, place: Place, names: Sequence[str]) -> Local:
        """Return the eigenvalues at a place and their derivatives by some parameters.

        Raises
        ------
        UsageError
            If the reference cannot move with one of them.
        MbstabError
            As `mbstab.analysis.spectrum.sensitivity.sensitivities`.
        """
        found = sensitivities(bound(self.model, settings_in_si(place)))
        for name in names:
            if name in found.missing:
                raise UsageError(f"{name} cannot be varied: {found.missing[name]}")
        columns = [found.parameters.index(name) for name in names]
        values, slopes, errors = [], [], []
        for item in found.derivatives:
            own, slope = found.eigenvalue(item), item.slopes[columns]
            value, error = own.value, own.error_bound
            values += [value, value.conjugate()] if value.imag else [value]
            slopes += [slope, slope.conj()] if value.imag else [slope]
            errors += [error, error] if value.imag else [error]
        return Local(
            np.array(values, dtype=complex), np.array(slopes).reshape(len(values), len(columns)), np.array(errors)
        )

    def known(self, place: Place, names: Sequence[str]) -> Local | None:
        """Return the eigenvalues at a place and their derivatives, or None if there are none."""
        try:
            return self.local(place, names)
        except UsageError:
            raise
        except MbstabError:
            return None
