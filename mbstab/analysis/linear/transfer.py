"""Transfer functions of the linear model from one input to one output: values, zeros, and responses over time.

Rates and second derivatives of an input count with s and s²; what of them reaches the output directly is a polynomial:

    G(s) = C (s − A)⁻¹ B + D₀ + s D₁ + s² D₂,   B = b₀ + A b₁ + A² b₂,   D₀ = d₀ + C b₁ + C A b₂,   D₁ = d₁ + C b₂.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.control import ControlModel
from mbstab.analysis.linear.responding import responding
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import NumericalError, UsageError, suggestion
from mbstab.records import dataclass


@dataclass(frozen=True)
class Seen:
    """The part of a system that an input reaches and an output sees.

    Attributes
    ----------
    A, B, C : ndarray, shapes (n, n), (n,), (n,)
    hidden : int
        How many eigenvalues are not in it.
    doubt : str
        Why this number is not decided; empty if it is.
    """

    A: Array
    B: Array
    C: Array
    hidden: int
    doubt: str


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

    def at(self, omega: Array) -> Complex:
        """Return G(iω) at angular frequencies (rad/s); infinite, with a part that is nan, on a pole."""
        found = np.zeros(len(omega), dtype=complex)
        if self.vanishes:
            return found
        for k, s in enumerate(1j * np.asarray(omega)):
            try:
                x = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
            except np.linalg.LinAlgError:
                found[k] = complex(np.inf, np.nan)
                continue
            found[k] = self.C @ x + self.D @ s ** np.arange(3)
        return found

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

    def seen(self) -> Seen:
        """Return what of the states the input reaches and the output sees."""
        ranks = _Ranks()
        A, B, C = _reached(self.A, self.B, self.C, ranks)
        A_t, C_t, B_t = _reached(A.T, C, B, ranks)
        doubt = ranks.doubt
        if not len(A_t) and not np.any(self.D) and not self.vanishes:
            doubt = f"the response is below {TOLERANCES.unreached:g} of the sizes of A, B and C"
        return Seen(A_t.T, B_t, C_t, len(self.A) - len(A_t), doubt)


class _Ranks:
    """Decisions whether a number vanishes beside another, and how clear they are."""

    def __init__(self) -> None:
        self.kept, self.dropped = np.inf, 0.0

    def vanishes(self, value: float, size: float) -> bool:
        """Whether a value is zero beside a size."""
        part = value / size if size > 0.0 else np.inf if value > 0.0 else 0.0
        if part <= TOLERANCES.unreached:
            self.dropped = max(self.dropped, part)
            return True
        self.kept = min(self.kept, part)
        return False

    @property
    def doubt(self) -> str:
        """What is not clear; empty if all is."""
        if self.kept >= max(ALGEBRA.singular_value_kept, ALGEBRA.rank_gap * self.dropped):
            return ""
        return f"{self.kept:.1e} was taken for different from 0, and {self.dropped:.1e} for 0"


def _reached(A: Array, B: Array, C: Array, ranks: _Ranks) -> tuple[Array, Array, Array]:
    """Return a system on the smallest subspace that contains B and that A maps into itself."""
    size = float(np.linalg.norm(A))
    basis = np.zeros((len(A), 0))
    x, scale = B, float(np.linalg.norm(B))
    while basis.shape[1] < len(A):
        for _ in range(2):
            x = x - basis @ (basis.T @ x)
        length = float(np.linalg.norm(x))
        if ranks.vanishes(length, scale):
            break
        basis = np.column_stack([basis, x / length])
        x, scale = A @ basis[:, -1], size
    return basis.T @ A @ basis, basis.T @ B, C @ basis


def simple_eigenvalues(A: Array, size: float) -> tuple[Complex, Array]:
    """Return eigenvalues and first-order estimates of their errors, for a matrix known to roundings of a size."""
    from scipy.linalg import eig

    values, left, right = eig(A, left=True)
    condition = 1.0 / np.maximum(np.abs(np.sum(left.conj() * right, axis=0)), EPS)
    return values, TOLERANCES.roundings_of_zeros * EPS * size * condition


def number_of(name: str, known: tuple[str, ...], what: str, listed: str) -> int:
    """Return the number of a name; refuse one that is not known."""
    if name not in known:
        hint = suggestion(name, known) or f"{listed}: " + (", ".join(known) or "none")
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
