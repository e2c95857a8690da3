"""Transfer functions of the linear model from one input to one output: values, zeros, and responses over time.

Rates and second derivatives of an input count with s and s²; what of them reaches the output directly is a polynomial:

    G(s) = C (s − A)⁻¹ B + D₀ + s D₁ + s² D₂,   B = b₀ + A b₁ + A² b₂,   D₀ = d₀ + C b₁ + C A b₂,   D₁ = d₁ + C b₂.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.response.responding import responding
from mbstab.analysis.response.state_space import ControlModel
from mbstab.compiler.system import Array
from mbstab.errors import NumericalError, UsageError, alternatives
from mbstab.records import dataclass


@dataclass(frozen=True)
class Channel:
    """One input and one output.

    Attributes
    ----------
    source, goal : str
        Their names.
    source_unit, goal_unit : str
    A, B, C : ndarray, shapes (n, n), (n,), (n,)
        States are scaled, so that they are not those of the model.
    D : ndarray, shape (3,)
        The polynomial D₀, D₁, D₂.
    """

    source: str
    goal: str
    source_unit: str
    goal_unit: str
    A: Array
    B: Array
    C: Array
    D: Array

    @property
    def vanishes(self) -> bool:
        """Whether it is exactly zero: nothing leads from the input to the output."""
        return not np.any(self.C) and not np.any(self.D)

    def without(self, hidden: Complex, others: Complex) -> Channel:
        """Return the channel without the motions of eigenvalues that the input does not reach or the output not see.

        In numbers they are reached by rounding errors, which would grow with them beyond all that is seen.

        Parameters
        ----------
        hidden, others : ndarray of complex (1/s)
            These eigenvalues, and the other ones of A.
        """
        from scipy.linalg import schur, solve_sylvester

        if not len(hidden):
            return self

        def stays(real: float, imag: float) -> bool:
            s = complex(real, imag)
            return bool(np.min(np.abs(others - s), initial=np.inf) <= np.min(np.abs(hidden - s)))

        T, Q, n = schur(self.A, output="real", sort=stays)
        X = solve_sylvester(T[:n, :n], -T[n:, n:], -T[:n, n:])
        B = Q.T @ self.B
        return replace(self, A=T[:n, :n], B=B[:n] - X @ B[n:], C=self.C @ Q[:, :n])

    def step(self, times: Array, impulse: bool = False) -> Array:
        """Return the output after a unit step, or a unit impulse, of the input at time 0, without its impulses.

        Parameters
        ----------
        times : ndarray, shape (n_t,)
            Equally spaced from 0 (s).

        Raises
        ------
        UsageError
            If the output has impulses: it follows the rate of the input.
        NumericalError
            If the states or the output overflow.
        """
        from scipy.linalg import expm

        if np.any(self.D[(0 if impulse else 1) :]):
            what = "an impulse" if impulse else "a step"
            raise UsageError(
                f"{self.goal} has impulses after {what} of {self.source}, which it follows directly\n"
                "hint: ask for its frequency response"
            )
        n = len(self.A)
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n], whole[:n, n] = self.A, self.B
        state = np.append(self.B, 0.0) if impulse else np.append(np.zeros(n), 1.0)
        out = np.empty(len(times))
        with np.errstate(all="ignore"):
            advance = expm(whole * (times[1] - times[0]))
            for k in range(len(times)):
                out[k] = self.C @ state[:n] + (0.0 if impulse else self.D[0])
                state = advance @ state
        if not np.all(np.isfinite(out)):
            at = int(np.argmin(np.isfinite(out)))
            raise NumericalError(
                f"{self.goal} after a change of {self.source}: numbers above 1e308 between {times[at - 1]:g} and "
                f"{times[at]:g} s\nhint: ask for a shorter time"
            )
        return out


def number_of(name: str, known: tuple[str, ...], what: str, listed: str) -> int:
    """Return the number of a name; refuse one that is not known."""
    if name not in known:
        hint = alternatives(name, known, listed)
        raise UsageError(f"there is no {what} {name!r}\nhint: {hint}")
    return known.index(name)


def channels(model: ControlModel, sources: tuple[str, ...] = (), goals: tuple[str, ...] = ()) -> list[Channel]:
    """Return the channels from some inputs, or all, to some outputs, or all.

    Raises
    ------
    UsageError
        If a name is unknown, or the file declares no inputs or no outputs.
    """
    from scipy.linalg import matrix_balance

    for what, found in (("inputs", model.inputs), ("outputs", model.outputs)):
        if not found:
            raise UsageError(f"the model declares no {what}\nhint: add the section {what}: to the file")
    ins = [number_of(x, model.inputs, "input", "inputs of the file") for x in sources or model.inputs]
    outs = [number_of(x, model.outputs, "output", "outputs of the file") for x in goals or model.outputs]
    A, (scale, _) = matrix_balance(model.A, permute=False, separate=True)
    result, told = [], responding(model)
    for i in ins:
        b, d = np.zeros((3, len(A))), np.zeros((3, len(model.outputs)))
        for column, (own, k) in enumerate(model.orders):
            if own == i:
                b[k], d[k] = model.B[:, column] / scale, model.D[:, column]
        B = b[0] + A @ (b[1] + A @ b[2])
        for j in outs:
            C = model.C[j] * scale * told[j, i]
            D = told[j, i] * np.array([d[0, j] + C @ (b[1] + A @ b[2]), d[1, j] + C @ b[2], d[2, j]])
            units = model.input_units[i], model.output_units[j]
            result.append(Channel(model.inputs[i], model.outputs[j], *units, A, B, C, D))
    return result
