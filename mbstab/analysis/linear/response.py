"""Frequency responses, zeros and step responses of the linear model from one input to one output.

Rates and second derivatives of an input count with s and s²; what of them reaches the output directly is a polynomial:

    G(s) = C (s − A)⁻¹ B + D₀ + s D₁ + s² D₂,   B = b₀ + A b₁ + A² b₂,   D₀ = d₀ + C b₁ + C A b₂,   D₁ = d₁ + C b₂.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.control import ControlModel
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.compiler.system import Array
from mbstab.errors import UsageError, suggestion
from mbstab.records import dataclass


@dataclass(frozen=True)
class Zeros:
    """The zeros of a transfer function.

    Attributes
    ----------
    values : ndarray of complex (1/s)
        Sorted by their real parts.
    errors : ndarray
        First-order estimates of their errors: condition times backward error.
    hidden : int
        How many eigenvalues the input does not reach or the output does not see.
    vanishes : bool
        Whether the transfer function is zero.
    """

    values: Complex
    errors: Array
    hidden: int
    vanishes: bool

    @property
    def minimum_phase(self) -> bool | None:
        """Whether all zeros lie left of the imaginary axis; None: the errors do not decide it."""
        if np.any(self.values.real > self.errors):
            return False
        return True if np.all(self.values.real < -self.errors) and not self.vanishes else None


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

    def at(self, omega: Array) -> Complex:
        """Return G(iω) at angular frequencies (rad/s); infinite on a pole."""
        found = np.empty(len(omega), dtype=complex)
        for k, s in enumerate(1j * np.asarray(omega)):
            try:
                x = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B.astype(complex))
            except np.linalg.LinAlgError:
                found[k] = np.inf
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
        advance = expm(whole * (times[1] - times[0]))
        state = np.append(self.B, 0.0) if impulse else np.append(np.zeros(n), 1.0)
        out = np.empty(len(times))
        for k in range(len(times)):
            out[k] = self.C @ state[:n] + (0.0 if impulse else self.D[0])
            state = advance @ state
        return out

    def zeros(self) -> Zeros:
        """Return the zeros, without the eigenvalues that the input does not reach or the output does not see."""
        A, B, C = _reached(self.A, self.B, self.C)
        A_t, C_t, B_t = _reached(A.T, C, B)
        A, B, C, hidden = A_t.T, B_t, C_t, len(self.A) - len(A_t)
        D = self.D[0]
        if np.any(self.D[1:]):
            # The second derivative of the input as input, the input and its rate as states: the zeros stay.
            n = len(A)
            wide = np.zeros((n + 2, n + 2))
            wide[:n, :n], wide[:n, n], wide[n, n + 1] = A, B, 1.0
            A, B, C, D = wide, np.eye(n + 2)[n + 1], np.concatenate([C, self.D[:2]]), self.D[2]
        return _zeros(A, B, C, float(D), hidden)


def _reached(A: Array, B: Array, C: Array) -> tuple[Array, Array, Array]:
    """Return a system on the smallest subspace that contains B and that A maps into itself."""
    size = float(np.linalg.norm(A))
    basis = np.zeros((len(A), 0))
    x, scale = B, float(np.linalg.norm(B))
    while basis.shape[1] < len(A):
        for _ in range(2):
            x = x - basis @ (basis.T @ x)
        length = float(np.linalg.norm(x))
        if length <= TOLERANCES.unreached * scale:
            break
        basis = np.column_stack([basis, x / length])
        x, scale = A @ basis[:, -1], size
    return basis.T @ A @ basis, basis.T @ B, C @ basis


def _zeros(A: Array, B: Array, C: Array, D: float, hidden: int) -> Zeros:
    """Return the zeros: the motions that keep the output zero, one derivative of it after the other."""
    while len(A) and abs(D) <= TOLERANCES.unreached * np.linalg.norm(B) * np.linalg.norm(C):
        length = float(np.linalg.norm(C))
        if length <= TOLERANCES.unreached * np.linalg.norm(A):
            return Zeros(np.zeros(0, dtype=complex), np.zeros(0), hidden, True)
        c = C / length
        Q = np.linalg.qr(c[:, None], mode="complete")[0][:, 1:]
        A, B, C, D = Q.T @ A @ Q, Q.T @ B, (c @ A) @ Q, float(c @ B)
    if not len(A):
        return Zeros(np.zeros(0, dtype=complex), np.zeros(0), hidden, D == 0.0)
    from scipy.linalg import eig

    F = A - np.outer(B, C) / D
    values, left, right = eig(F, left=True)
    condition = 1.0 / np.maximum(np.abs(np.sum(left.conj() * right, axis=0)), EPS)
    size = float(np.linalg.norm(A) + np.linalg.norm(np.outer(B, C)) / abs(D))
    errors = TOLERANCES.roundings_of_zeros * EPS * size * condition
    order = np.lexsort((values.imag, values.real))
    return Zeros(values[order], errors[order], hidden, False)


def _number(name: str, known: tuple[str, ...], what: str) -> int:
    if name not in known:
        hint = suggestion(name, known) or f"{what}s of the file: " + (", ".join(known) or "none")
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
    ins = [_number(x, model.inputs, "input") for x in sources or model.inputs]
    outs = [_number(x, model.outputs, "output") for x in goals or model.outputs]
    A, (scale, _) = matrix_balance(model.A, permute=False, separate=True)
    result = []
    for i in ins:
        b, d = np.zeros((3, len(A))), np.zeros((3, len(model.outputs)))
        for column, (own, k) in enumerate(model.orders):
            if own == i:
                b[k], d[k] = model.B[:, column] / scale, model.D[:, column]
        B = b[0] + A @ (b[1] + A @ b[2])
        for j in outs:
            C = model.C[j] * scale
            D = np.array([d[0, j] + C @ (b[1] + A @ b[2]), d[1, j] + C @ b[2], d[2, j]])
            units = model.input_units[i], model.output_units[j]
            result.append(Channel(model.inputs[i], model.outputs[j], *units, A, B, C, D))
    return result


def frequencies(model: ControlModel, start: float | None, stop: float | None, points: int) -> Array:
    """Return angular frequencies (rad/s) in equal ratios; without ends, a decade beyond those of the eigenvalues."""
    sizes: Any = np.abs(np.asarray(np.linalg.eigvals(model.A), dtype=complex))
    sizes = sizes[sizes > TOLERANCES.slow_eigenvalue * np.max(sizes, initial=0.0)]
    low = start if start is not None else 0.1 * float(np.min(sizes, initial=np.inf)) if len(sizes) else 0.1
    high = stop if stop is not None else 10.0 * float(np.max(sizes)) if len(sizes) else 100.0
    if not 0.0 < low < high < np.inf:
        raise UsageError(f"frequencies from {low:g} to {high:g} rad/s: two positive numbers, the smaller first")
    return np.geomspace(low, high, points)


@dataclass(frozen=True)
class Response:
    """Frequency responses, or responses over time, of several channels.

    Attributes
    ----------
    kind : str
        ``frequency``, ``step`` or ``impulse``.
    channels : tuple of Channel
    x : ndarray, shape (points,)
        Angular frequencies (rad/s) or times (s).
    values : tuple of ndarray, shape (points,)
        G(iω), or the output over time.
    zeros : tuple of Zeros
    poles : ndarray of complex (1/s)
        Eigenvalues of A.
    """

    kind: str
    channels: tuple[Channel, ...]
    x: Array
    values: tuple[Any, ...]
    zeros: tuple[Zeros, ...]
    poles: Complex


def answer(
    model: ControlModel,
    sources: tuple[str, ...] = (),
    goals: tuple[str, ...] = (),
    ends: tuple[float | None, float | None] = (None, None),
    points: int = 201,
    duration: float | None = None,
    impulse: bool = False,
) -> Response:
    """Return frequency responses, or with a duration (s) those to a unit step or impulse, with zeros.

    Raises
    ------
    UsageError
        If names are unknown, frequencies out of order, or an output has impulses.
    """
    found = channels(model, sources, goals)
    kind = "frequency" if duration is None else "impulse" if impulse else "step"
    x = frequencies(model, *ends, points) if duration is None else np.linspace(0.0, duration, points)
    values = tuple(c.at(x) if duration is None else c.step(x, impulse) for c in found)
    poles: Complex = np.linalg.eigvals(model.A.astype(complex))
    return Response(kind, tuple(found), x, values, tuple(c.zeros() for c in found), poles)
