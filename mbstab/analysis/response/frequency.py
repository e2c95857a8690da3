"""Values of transfer functions on the imaginary axis, from the unreduced equations, with error bounds.

The entries of the index-3 system (s E − A) y = B w, z = C y + D w come from the elements, and their zeros are exact;
a reduction to states would fill them with rounding. With X = (s E − A)⁻¹ B and Y = C (s E − A)⁻¹ an error δ of the
entries changes the response by Y δ X, and a residual R of X by Y R, which is added: to first order the error is

    |Y| (δE |s| + δA + ε |s E − A|) |X| + ε (|Y| |B| + |C| |X|)

(Skeel 1980, Math. Comp. 35).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.refinement import equilibration
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.roundings import roundings
from mbstab.analysis.linear.tolerances import TOLERANCES as LINEAR
from mbstab.analysis.response.descriptor import Unreduced
from mbstab.analysis.response.responding import responding
from mbstab.analysis.response.state_space import ControlModel
from mbstab.analysis.response.tolerances import TOLERANCES
from mbstab.analysis.response.transfer import Channel
from mbstab.compiler.system import Array


class FrequencyResponse:
    """G(iω) from all inputs to all outputs.

    Parameters
    ----------
    model : ControlModel or Unreduced
    """

    def __init__(self, model: ControlModel | Unreduced) -> None:
        self.model, found, linear = model, model.descriptor, model.linear
        n, c = len(linear.M), len(linear.J)
        redundant = [id(item.row) for item in linear.motion.redundant]
        kept = np.array([i for i, row in enumerate(linear.rows) if id(row) not in redundant], dtype=int)
        size = len(found.A)
        rows = np.concatenate([np.arange(2 * n), 2 * n + kept, np.arange(2 * n + c, size)])
        columns = np.concatenate([np.arange(n), n + kept, np.arange(n + c, size)])
        self._own, self._size = np.ix_(rows, columns), size
        self.E, self.A, self.B, self.C = found.E[self._own], found.A[self._own], found.B[rows], found.C[:, columns]
        # How often each variable is differentiated: Δq and Δν, Δu, Δa.
        self.rate = np.zeros(len(rows))
        self.rate[n + len(kept) : 2 * n + len(kept)], self.rate[2 * n + len(kept) :] = 1, 2
        self.rounding, self.responds = LINEAR.roundings_of_sum * EPS, responding(model)
        self._scales: dict[int, tuple[Array, Array]] = {}
        self.sparse = len(self.A) >= TOLERANCES.sparse_response
        if self.sparse:
            from scipy.sparse import csc_array

            self.E, self.A = csc_array(self.E), csc_array(self.A)

    @cached_property
    def errors(self) -> tuple[Any, Any]:
        """Error bounds of the entries of E and A."""
        linear, size = self.model.linear, self._size
        n, c = len(linear.M), len(linear.J)
        known = roundings(linear).errors
        errors_A, errors_E = (np.abs(x) for x in replace(linear, **known._asdict()).pencil())
        errors_A[:n], errors_E[:n] = 0.0, 0.0  # Δq̇ = Δu
        wide_A, wide_E = np.zeros((size, size)), np.zeros((size, size))
        wide_A[: 2 * n + c, : 2 * n + c] = errors_A
        if size == 2 * n + c:
            wide_E = errors_E
        else:
            wide_A[n : 2 * n, 2 * n + c :] = known.M  # M stands beside the accelerations
        found = self.model.descriptor
        both = ((wide + self.rounding * np.abs(own))[self._own] for wide, own in ((wide_E, found.E), (wide_A, found.A)))
        if self.sparse:
            from scipy.sparse import csc_array

            both = (csc_array(x) for x in both)
        return next(both), next(both)

    def bordered(self, s: complex) -> Complex:
        """Return [s E - A, B; C, D(s)], shape (n + outputs, n + inputs)."""
        whole = s * self.E - self.A
        found: Complex = np.block([[whole.toarray() if self.sparse else whole, self.B], [self.C, self._direct(s)]])
        return found

    def powers(self, channel: tuple[int, int], shift: float) -> npt.NDArray[np.bool_]:
        """Return which entries of [s E - A, B; C, D(s) + shift] have terms with s^0, s^1, s^2.

        Parameters
        ----------
        channel : (int, int)
            Numbers of the output and the input.

        Returns
        -------
        ndarray of bool, shape (3, n + 1, n + 1)
        """
        goal, source = channel
        n = len(self.B)
        found = np.zeros((3, n + 1, n + 1), dtype=bool)
        for power, entries in enumerate((self.A, self.E)):
            found[power, :n, :n] = (entries.toarray() if self.sparse else entries) != 0.0
        found[0, :n, n], found[0, n, :n], found[0, n, n] = self.B[:, source] != 0.0, self.C[goal] != 0.0, shift != 0.0
        for column, (i, order) in enumerate(self.model.orders):
            found[order, n, n] |= i == source and bool(self.model.descriptor.D[goal, column])
        return found

    def entry_errors(self, s: complex) -> Array:
        """Return error bounds of the entries of s E - A, shape (n, n)."""
        errors_E, errors_A = self.errors
        found = abs(s) * errors_E + errors_A
        return np.asarray(found.toarray() if self.sparse else found)

    def value(self, s: complex) -> Complex:
        """Return G(s), shape (outputs, inputs); infinite on a pole."""
        whole, X, Y = self._solution(s)
        if X is None:
            return np.full(self.responds.shape, complex(np.inf, np.nan))
        found = self.C @ X + Y @ (self.B - whole @ X) + self._direct(s)
        return np.asarray(np.where(self.responds, found, 0.0))

    def _solution(self, s: complex) -> tuple[Any, Any, Any]:
        """Return P = s E - A, P⁻¹ B and C P⁻¹; the last two are None on a pole."""
        whole = s * self.E - self.A
        decade = round(np.log2(abs(s) or 1.0) / 4.0)
        if decade not in self._scales:
            self._scales[decade] = equilibration(abs(whole), *self._start(abs(s) or 1.0))
        return whole, *_solved(whole, *self._scales[decade], self.B, self.C)

    def at(self, s: complex) -> tuple[Complex, Array, Complex]:
        """Return G(s), its error bounds and G'(s), shapes (outputs, inputs); infinite and nan on a pole.

        Parameters
        ----------
        s : complex (1/s)
        """
        direct = self._direct(s)
        whole, X, Y = self._solution(s)
        if X is None:
            nothing = np.full(direct.shape, complex(np.inf, np.nan))
            return nothing, np.full(direct.shape, np.inf), nothing
        errors_E, errors_A = self.errors
        sizes = errors_A + abs(s) * errors_E
        rest = self.B - whole @ X
        value = self.C @ X + Y @ rest + direct
        error = np.abs(Y) @ (sizes @ np.abs(X) + self.rounding * np.abs(self.B) + np.abs(rest))
        error += self.rounding * (np.abs(self.C) @ np.abs(X) + np.abs(direct))
        slope = self._direct(s, 1) - Y @ (self.E @ X)
        return tuple(np.where(self.responds, x, 0.0) for x in (value, error, slope))  # type: ignore[return-value]

    def over(self, omega: Array) -> tuple[Complex, Array]:
        """Return G(iω) and its error bounds at frequencies, shapes (outputs, inputs, frequencies)."""
        shape = len(self.C), self.B.shape[1], len(omega)
        values, errors = np.zeros(shape, dtype=complex), np.zeros(shape)
        for k, x in enumerate(omega):
            values[:, :, k], errors[:, :, k], _ = self.at(1j * float(x))
        return values, errors

    def of(self, channel: Channel) -> Callable[[Array], tuple[Complex, Array]]:
        """Return the function of frequencies that returns G(iω) and its error bounds from one input to one output."""
        at = self.number(channel)

        def values(omega: Array) -> tuple[Complex, Array]:
            found, errors = self.over(omega)
            return found[at], errors[at]

        return values

    def number(self, channel: Channel) -> tuple[int, int]:
        """Return the numbers of the output and the input of a channel."""
        return self.model.outputs.index(channel.goal), self.model.inputs.index(channel.source)

    def _start(self, size: float) -> tuple[Array, Array]:
        """Return factors of rows and columns with which Δq̇ = Δu and Δu̇ = Δa do not depend on the size of s."""
        step = float(np.exp2(np.clip(np.round(np.log2(size)), -300.0, 300.0)))
        left, right = np.ones(len(self.rate)), np.ones(len(self.rate))
        right *= step**self.rate
        n = len(self.model.linear.M)
        left[:n] = 1.0 / step
        left[self.rate == 2] = step**-2.0
        return left, right

    def _direct(self, s: complex, slope: int = 0) -> Complex:
        """Return D₀ + s D₁ + s² D₂, or its derivative by s."""
        D = self.model.descriptor.D
        found = np.zeros((len(self.C), self.B.shape[1]), dtype=complex)
        for column, (i, order) in enumerate(self.model.orders):
            if order >= slope:
                found[:, i] += D[:, column] * (order * s ** (order - 1) if slope else s**order)
        return found


def _solved(whole: Any, left: Array, right: Array, B: Array, C: Array) -> tuple[Any, Any]:
    """Return P⁻¹ B and C P⁻¹ with small residuals, entry by entry; None where that is not reached.

    The rows and columns of P are scaled, and solutions are refined (Skeel 1980).
    """
    scaled = whole * left[:, None] * right
    if isinstance(scaled, np.ndarray):
        from scipy.linalg.lapack import zgecon, zgetrf, zgetrs

        lu, pivots, singular = zgetrf(scaled)
        # Beside a singular matrix, also at an eigenvalue that is hidden, first-order bounds do not hold.
        if singular or zgecon(lu, np.linalg.norm(scaled, 1))[0] <= TOLERANCES.singular_response * EPS:
            return None, None

        def solve(b: Complex, transposed: bool) -> Complex:
            return np.asarray(zgetrs(lu, pivots, b, trans=int(transposed))[0])
    else:
        from scipy.sparse.linalg import splu

        try:
            factors = splu(scaled.tocsc())
        except RuntimeError:
            return None, None

        def solve(b: Complex, transposed: bool) -> Complex:
            return np.asarray(factors.solve(b, trans="T" if transposed else "N"))

    X = _refined(whole, B.astype(complex), left, lambda b: right[:, None] * solve(left[:, None] * b, False))
    Y = _refined(whole.T, C.astype(complex).T, right, lambda b: left[:, None] * solve(right[:, None] * b, True))
    return (None, None) if X is None or Y is None else (X, Y.T)


def _refined(P: Any, b: Complex, rows: Array, solve: Callable[[Complex], Complex]) -> Complex | None:
    """Return the solution of P x = b, or None if its residuals, in scaled rows, stay larger than rounding."""
    sizes, x = abs(P), solve(b)
    for _ in range(TOLERANCES.refinements_of_response):
        rest, terms = np.abs(b - P @ x), sizes @ np.abs(x) + np.abs(b)
        if np.all(rest <= TOLERANCES.residual_of_response * EPS * terms):
            break
        x = x + solve(b - P @ x)
    largest = (float(np.max(rows[:, None] * y, initial=0.0)) for y in (rest, terms))
    return x if next(largest) <= TOLERANCES.residual_largest * next(largest) else None
