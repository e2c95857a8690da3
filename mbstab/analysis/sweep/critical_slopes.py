"""Derivatives of critical values by the other parameters.

At a critical value p* something of the spectrum is zero: the real part of a pair, an eigenvalue, or the difference of
two that meet on the imaginary axis. As another parameter q moves, it stays zero:

    dp*/dq = −(∂z/∂q) / (∂z/∂p)

(implicit function theorem; Seyranian and Mailybaev 2003, Multiparameter Stability Theory, chapter 2). Where eigenvalues
are simple, their derivatives are taken at p* itself. Where they are not, such as a zero eigenvalue among neutral ones
or the double one of a collision, single derivatives grow without bound or are not known, yet their ratio is a smooth
function of p: it is taken at values on both sides of p* and interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mbstab.analysis.spectrum.sensitivity import Derivatives, Sensitivities, sensitivities
from mbstab.analysis.sweep.critical import Critical, CriticalSlopes
from mbstab.analysis.sweep.sweep import Sweep
from mbstab.analysis.sweep.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import MbstabError, NumericalError
from mbstab.model.parameters import bound, settings_in_si
from mbstab.model.schema import Model
from mbstab.records import dataclass

WITHOUT = {
    "branch point": "other equilibria branch off there",
    "fold": "the path of equilibria turns back there",
    "loss of equilibrium": "the path of equilibria ends there",
    "end of the equations": "the equations end there",
    "infinity": "an eigenvalue is infinite there",
    "unresolved": "it is not known what happens there",
}
"""Why critical values of some kinds have no derivatives."""

NODES = np.array([1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0])
"""Places on both sides, in steps."""

SIX = np.repeat([15.0, -6.0, 1.0], 2) / 20.0
EIGHT = np.repeat([56.0, -28.0, 8.0, -1.0], 2) / 70.0
"""Values at the middle of the polynomial through so many of the places."""


def with_slopes(model: Model, sweep: Sweep, progress: Callable[[float], object] = lambda done: None) -> Sweep:
    """Return a sweep whose critical values have derivatives by the other parameters, or say why they have none.

    Parameters
    ----------
    model : Model
        That of the sweep.
    progress : callable
        Is called with the part of the work that is done, from 0 to 1.
    """
    found = []
    for number, critical in enumerate(sweep.critical, 1):
        found.append(replace(critical, slopes=_slopes(model, sweep, critical)))
        progress(number / len(sweep.critical))
    reason = CriticalSlopes(missing="it is on a path beyond a fold; only critical values of the first path have them")
    paths = (replace(path, critical=tuple(replace(x, slopes=reason) for x in path.critical)) for path in sweep.beyond)
    return replace(sweep, critical=tuple(found), beyond=tuple(paths))


def _slopes(model: Model, sweep: Sweep, critical: Critical) -> CriticalSlopes:
    """Return the derivatives of a critical value, or why there are none."""
    if critical.kind in WITHOUT:
        return CriticalSlopes(missing=WITHOUT[critical.kind])
    if critical.branching:
        return CriticalSlopes(missing=WITHOUT["branch point"])
    if critical.kind == "divergence" and len(critical.branches) > 1:
        return CriticalSlopes(missing=f"{len(critical.branches)} eigenvalues pass zero there together")
    place = _Place(model, sweep, critical)
    if critical.kind != "collision":
        found = place.itself()
        settled = not found.missing and bool(found.relative <= TOLERANCES.slope_settled)
        if settled or critical.kind == "flutter":
            return found
    try:
        return place.between()
    except MbstabError as error:
        return CriticalSlopes(missing=str(error).splitlines()[0])


@dataclass(frozen=True)
class _Ratio:
    """What a critical value moves by at a place beside it.

    Attributes
    ----------
    slopes, errors : ndarray, shape (parameters,)
        −(∂z/∂q)/(∂z/∂p), nan where there is none.
    square : complex
        z², which is a smooth function of p with a zero at the critical value.
    """

    slopes: Array
    errors: Array
    square: complex


class _Place:
    """A critical value of a sweep."""

    def __init__(self, model: Model, sweep: Sweep, critical: Critical) -> None:
        self.model, self.parameter, self.critical = model, sweep.parameter, critical
        others = [abs(c.value - critical.value) for c in sweep.critical if c.value != critical.value]
        ends = [float(abs(x - critical.value)) for x in sweep.values[[0, -1]] if x != critical.value]
        size = max(abs(critical.value), float(abs(sweep.values[-1] - sweep.values[0])) * TOLERANCES.slope_reach)
        self.step = min([TOLERANCES.slope_reach * size, *(0.25 * x for x in [*others, *ends])])
        self.names: tuple[str, ...] = tuple(name for name in model.parameters if name != sweep.parameter)
        self.values = np.zeros(0)
        self.missing: dict[str, str] = {}

    def itself(self) -> CriticalSlopes:
        """Return the derivatives from those of the eigenvalue at the critical value."""
        critical = self.critical
        try:
            found = self._at(critical.value)
            (item,) = self._nearest(found, 1)
        except MbstabError as error:
            return CriticalSlopes(missing=str(error).splitlines()[0])
        e, scale = found.eigenvalue(item), max(abs(x.value) for x in found.result.eigenvalues)
        if critical.kind == "divergence" and e.value.imag:
            return CriticalSlopes(missing="a pair meets there")
        off = abs(e.value.real) + abs(abs(e.value.imag) - critical.frequency)
        if off > e.error_bound + TOLERANCES.test_function_zero * scale:
            return CriticalSlopes(missing="the motion found there is not that of the sweep")
        slopes, errors = self._quotient(found, item.slopes.real, item.errors)
        along = abs(item.slopes[found.parameters.index(self.parameter)].real)
        # How well the critical value itself is known, relative to its size.
        known = (abs(e.value.real) + e.error_bound) / along / max(abs(critical.value), self.step)
        return self._answer(slopes, errors + known * np.abs(slopes))

    def between(self) -> CriticalSlopes:
        """Return the derivatives from those of eigenvalues on both sides.

        Raises
        ------
        NumericalError
            If these are not those of a smooth function.
        MbstabError
            If there is no answer on one of the sides.
        """
        best, failure = CriticalSlopes(), NumericalError("the derivatives on both sides do not agree with each other")
        for pairs in (False, True) if self.critical.kind == "divergence" else (True,):
            for trial in range(TOLERANCES.slope_trials):
                try:
                    found = self._interpolated(self.step / 4.0**trial, pairs)
                except NumericalError as error:
                    failure = error
                    continue
                if found.relative <= TOLERANCES.slope_fine:
                    return found
                best = min(best, found, key=lambda x: x.relative if x.names else math.inf)
        if best.names and best.relative <= TOLERANCES.slope_settled:
            return best
        raise failure

    def _interpolated(self, step: float, pairs: bool) -> CriticalSlopes:
        """Return the derivatives from values at steps to both sides, of one eigenvalue or of pairs that meet."""
        ratios = [self._ratio(self.critical.value + step * x, pairs) for x in NODES.tolist()]
        squares = np.array([x.square for x in ratios])
        if abs(EIGHT @ squares) > TOLERANCES.slope_square * float(np.max(np.abs(squares))):
            raise NumericalError("the motions on both sides are not those of the sweep")
        slopes = np.array([x.slopes for x in ratios])
        value = EIGHT @ slopes
        errors = np.abs(value - SIX @ slopes[:6]) + np.abs(EIGHT) @ np.array([x.errors for x in ratios])
        return self._answer(value, errors)

    def _ratio(self, value: float, pairs: bool) -> _Ratio:
        """Return by what the critical value moves, as it shows at a place beside it."""
        found = self._at(value)
        (item, *others) = self._nearest(found, 2 if pairs else 1)
        z, dz, errors = found.eigenvalue(item).value, item.slopes, item.errors
        if others:
            # Half of the difference of two that meet, or of a pair, is ±√ of a smooth function.
            other = others[0]
            values = (z.conjugate(), dz.conj(), errors)
            if self.critical.kind != "divergence" or not z.imag:
                values = (found.eigenvalue(other).value, other.slopes, other.errors)
            z, dz, errors = 0.5 * (z - values[0]), dz - values[1], 0.5 * (errors + values[2])
            dz *= 0.5
        turn = np.conj(z) / abs(z) if z else 1.0
        slopes, errors = self._quotient(found, (turn * dz).real, errors)
        return _Ratio(slopes, errors, complex(z) ** 2)

    def _at(self, value: float) -> Sensitivities:
        """Return the derivatives of the eigenvalues at a value of the parameter."""
        found = sensitivities(bound(self.model, settings_in_si({self.parameter: value})))
        if self.parameter in found.missing:
            raise NumericalError(found.missing[self.parameter])
        self.missing |= found.missing
        self.values = np.delete(found.values, found.parameters.index(self.parameter))
        return found

    def _nearest(self, found: Sensitivities, count: int) -> Sequence[Derivatives]:
        """Return the derivatives of the eigenvalues next to the place on the axis."""
        place = 1j * self.critical.frequency
        order = sorted(found.derivatives, key=lambda x: abs(found.eigenvalue(x).value - place))[:count]
        for item in order:
            if item.missing:
                raise NumericalError(f"its eigenvalue has no derivative: {item.missing}")
        return order

    def _quotient(self, found: Sensitivities, slopes: Array, errors: Array) -> tuple[Array, Array]:
        """Return −(∂z/∂q)/(∂z/∂p) and the error of it, for all other parameters."""
        own = found.parameters.index(self.parameter)
        along, uncertain = slopes[own], errors[own]
        if not abs(along) > uncertain:
            raise NumericalError(f"{self.parameter} does not move the eigenvalue there")
        moved = -np.delete(slopes, own) / along
        return moved, (np.delete(errors, own) + np.abs(moved) * uncertain) / abs(along)

    def _answer(self, slopes: Array, errors: Array) -> CriticalSlopes:
        return CriticalSlopes(self.names, self.values, slopes, errors, reasons=dict(self.missing))
