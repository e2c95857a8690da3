"""Margins of a loop that is closed with an output, and the largest gain of a channel.

The output is subtracted from the input, so that the loop has the eigenvalues of 1 + G(s) = 0. Frequencies at which
|G(iω)| = γ are purely imaginary eigenvalues of a Hamiltonian pencil: zeros of γ² - G(-s) G(s) (Boyd, Balakrishnan and
Kabamba, Math. Control Signals Systems 2, 1989, 207-219; Bruinsma and Steinbuch, Syst. Control Lett. 14, 1990, 287-293).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.analysis.linear.transfer import Channel, simple_eigenvalues
from mbstab.compiler.system import Array
from mbstab.records import dataclass


@dataclass(frozen=True)
class GainCrossing:
    """Where the gain is 1.

    Attributes
    ----------
    frequency : float (rad/s)
    phase : float (degrees)
        Phase margin, from -180 to 180.
    delay : float (s)
        The smallest delay in the loop that brings an eigenvalue to the imaginary axis at this frequency.
    """

    frequency: float
    phase: float
    delay: float


@dataclass(frozen=True)
class PhaseCrossing:
    """Where the response is real and negative.

    Attributes
    ----------
    frequency : float (rad/s)
    factor : float
        Gain margin: the factor of the gain that brings an eigenvalue to the imaginary axis at this frequency.
    """

    frequency: float
    factor: float


@dataclass(frozen=True)
class Margins:
    """Margins of the loop.

    Attributes
    ----------
    closed : bool or None
        Whether the closed loop is stable; None: not decided.
    gain : tuple of PhaseCrossing
    phase : tuple of GainCrossing
        By frequency.
    always_real : bool
        The response is real at all frequencies: there are no single phase crossings.
    doubt : str
        Why the margins are not known; empty if they are.
    """

    closed: bool | None
    gain: tuple[PhaseCrossing, ...]
    phase: tuple[GainCrossing, ...]
    always_real: bool
    doubt: str = ""


@dataclass(frozen=True)
class LargestGain:
    """The H-infinity norm: the largest gain over all frequencies of a stable channel.

    Attributes
    ----------
    value : float
        Infinite if an eigenvalue is undamped or the gain grows without limit, nan if there is no norm.
    frequency : float (rad/s)
        Where it is reached; infinite if it is only approached at high frequencies.
    tolerance : float
        The norm lies between the value and (1 + tolerance) times the value.
    reason : str
        Why it is infinite or does not exist.
    """

    value: float
    frequency: float
    tolerance: float
    reason: str


def _slope(channel: Channel, omega: float) -> tuple[complex, complex]:
    """Return G(iω) and its derivative by ω."""
    s = 1j * omega
    whole = s * np.eye(len(channel.A)) - channel.A
    x = np.linalg.solve(whole, channel.B.astype(complex))
    D = channel.D
    value = channel.C @ x + D @ s ** np.arange(3)
    slope = -channel.C @ np.linalg.solve(whole, x) + D[1] + 2.0 * s * D[2]
    return complex(value), complex(1j * slope)


def _pencil_values(A: Array, E: Array) -> Complex:
    """Return the finite eigenvalues of a pencil, as far as they are told from infinite ones."""
    from scipy.linalg import eigvals

    alpha, beta = eigvals(A, E, homogeneous_eigvals=True)
    finite = np.abs(beta) > EPS * np.abs(alpha)
    found: Complex = alpha[finite] / beta[finite]
    return found


def _inputs_chain(channel: Channel) -> tuple[Array, Array, Array, Array]:
    """Return E ẋ = A x + B w, z = C x with the input, and its derivatives where they act, among the variables."""
    n, order = len(channel.A), int(np.max(np.flatnonzero(channel.D), initial=0))
    size = n + order + 1
    A, E, B, C = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), np.zeros(size)
    A[:n, :n], E[:n, :n] = channel.A, np.eye(n)
    A[:n, n] = channel.B
    # 0 = -p₀ + w, ṗ₀ = p₁, …
    A[n, n], B[n] = -1.0, 1.0
    for k in range(order):
        E[n + 1 + k, n + k], A[n + 1 + k, n + 1 + k] = 1.0, 1.0
    C[:n], C[n:] = channel.C, channel.D[: order + 1]
    return A, E, B, C


def _real_frequencies(
    channel: Channel, values: Complex, defect: Callable[[complex, complex], tuple[float, float]]
) -> list[float]:
    """Return frequencies at which a real function of G vanishes, near eigenvalues that are almost imaginary.

    Parameters
    ----------
    defect : callable
        Returns the function and its derivative by ω of G(iω) and its derivative.
    """
    found: list[float] = []
    near = np.abs(values.real) <= TOLERANCES.crossing_search * np.abs(values)
    for start in np.sort(np.abs(values[near].imag)):
        omega, step = float(start), np.inf
        for _ in range(TOLERANCES.newton_steps_crossing):
            if not 0.0 < omega < np.inf:
                break
            try:
                value, slope = defect(*_slope(channel, omega))
            except np.linalg.LinAlgError:
                break
            step = value / slope if slope != 0.0 else np.inf
            if not abs(step) < 0.5 * omega:
                break
            omega -= step
            if abs(step) <= TOLERANCES.crossing_found * omega:
                break
        known = any(abs(omega - x) <= TOLERANCES.crossing_apart * omega for x in found)
        if abs(step) <= TOLERANCES.crossing_apart * omega and omega > 0.0 and not known:
            found.append(omega)
    return sorted(found)


def gain_crossings(channel: Channel, gamma: float) -> list[float]:
    """Return the frequencies (rad/s) at which |G(iω)| = γ."""
    return _real_frequencies(channel, _level_values(channel, gamma), lambda g, d: _level(g, d, gamma))


def _level(g: complex, slope: complex, gamma: float) -> tuple[float, float]:
    size = abs(g)
    return size - gamma, (g.conjugate() * slope).real / size if size > 0.0 else 0.0


def _level_values(channel: Channel, gamma: float) -> Complex:
    """Return the zeros of γ² - G(-s) G(s)."""
    A, E, B, C = _inputs_chain(channel)
    B, C = _equal(B, C, gamma)
    n = len(A)
    # E ẋ = A x + B w, -Eᵀ ẏ = Aᵀ y + Cᵀ C x, w = Bᵀ y, with G divided by γ.
    whole, rates = np.zeros((2 * n + 1, 2 * n + 1)), np.zeros((2 * n + 1, 2 * n + 1))
    whole[:n, :n], rates[:n, :n], whole[:n, -1] = A, E, B
    whole[n : 2 * n, :n], whole[n : 2 * n, n : 2 * n], rates[n : 2 * n, n : 2 * n] = -np.outer(C, C), -A.T, E.T
    whole[-1, n : 2 * n], whole[-1, -1] = B, -1.0
    return _pencil_values(whole, rates)


def _equal(B: Array, C: Array, gamma: float) -> tuple[Array, Array]:
    """Return columns and rows of G/γ that are equally large."""
    b, c = np.linalg.norm(B), np.linalg.norm(C)
    t = np.sqrt(c / (b * gamma)) if b > 0.0 and c > 0.0 else 1.0
    return B * t, C / (t * gamma)


def _imaginary_values(channel: Channel) -> Complex:
    """Return the zeros of G(s) - G(-s)."""
    A, E, B, C = _inputs_chain(channel)
    n = len(A)
    whole, rates = np.zeros((2 * n + 1, 2 * n + 1)), np.zeros((2 * n + 1, 2 * n + 1))
    # The second system at -s: -E ẋ = A x + B w.
    whole[:n, :n], rates[:n, :n], whole[:n, -1] = A, E, B
    whole[n : 2 * n, n : 2 * n], rates[n : 2 * n, n : 2 * n], whole[n : 2 * n, -1] = A, -E, B
    whole[-1, :n], whole[-1, n : 2 * n] = C, -C
    return _pencil_values(whole, rates)


def margins(channel: Channel, exact: Callable[[Array], tuple[Complex, Array]], closed: bool | None) -> Margins:
    """Return the margins of the loop that is closed by subtracting the output from the input.

    Parameters
    ----------
    channel : Channel
    exact : callable
        Returns G(iω) and its error bounds at frequencies (rad/s).
    closed : bool or None
        Whether all zeros of 1 + G lie left of the imaginary axis; None: not decided.
    """
    seen = channel.seen()
    if seen.doubt:
        return Margins(closed, (), (), False, seen.doubt)
    own = replace(channel, A=seen.A, B=seen.B, C=seen.C)
    phase = []
    for omega in gain_crossings(own, 1.0):
        angle = float(np.degrees(np.angle(-_slope(own, omega)[0])))
        phase.append(GainCrossing(omega, angle, float(np.radians(angle % 360.0 or 360.0)) / omega))
    sample = own.at(_samples(own))
    real = bool(np.all(np.abs(sample.imag) <= TOLERANCES.real_response * np.abs(sample)))
    crossings = [] if real else _real_frequencies(own, _imaginary_values(own), lambda g, d: (g.imag, d.imag))
    if not real and not _singular(own.A, 0.0):
        crossings = [0.0, *crossings]
    values, errors = exact(np.array(crossings))
    if len(crossings) and not np.isfinite(errors[0]):
        values[0], errors[0] = _slope(own, crossings[0])[0], _rounding(own, crossings[0])
    # A gain that may be zero has no margin.
    gain = tuple(
        PhaseCrossing(omega, -1.0 / x) for omega, x, e in zip(crossings, values.real.tolist(), errors, strict=True)
        if x < -e
    )  # fmt: skip
    return Margins(closed, gain, tuple(phase), real)


def _rounding(channel: Channel, omega: float) -> float:
    """Return an estimate of the error of G(iω) from the rounding of A: at an eigenvalue outside of the channel."""
    A = channel.A
    whole = 1j * omega * np.eye(len(A)) - A
    x, y = np.linalg.solve(whole, channel.B.astype(complex)), np.linalg.solve(whole.T, channel.C.astype(complex))
    size = float(np.linalg.norm(y) * np.linalg.norm(A) * np.linalg.norm(x))
    return TOLERANCES.roundings_of_zeros * EPS * (size + abs(float(channel.D[0])))


def _singular(A: Array, s: complex) -> bool:
    """Whether A has an eigenvalue s, as far as rounding lets tell."""
    return _smallest(A, s) <= TOLERANCES.roundings_of_zeros * EPS * float(np.linalg.norm(A))


def _smallest(A: Array, s: complex) -> float:
    """Return the smallest singular value of A - s."""
    return float(np.linalg.svd(A - s * np.eye(len(A)), compute_uv=False)[-1]) if len(A) else np.inf


def _samples(channel: Channel) -> Array:
    """Return frequencies beside those of the eigenvalues (rad/s)."""
    sizes = np.abs(np.linalg.eigvals(channel.A))
    return np.unique(np.concatenate([sizes[sizes > 0.0] * 1.1, sizes[sizes > 0.0] * 0.7, [1.0]]))


def largest_gain(channel: Channel) -> LargestGain:
    """Return the H-infinity norm of what the input reaches and the output sees."""
    seen = channel.seen()
    if seen.doubt:
        return LargestGain(np.nan, np.nan, np.nan, f"what the input reaches is not decided: {seen.doubt}")
    own = replace(channel, A=seen.A, B=seen.B, C=seen.C)
    values, errors = simple_eigenvalues(own.A, float(np.linalg.norm(own.A)))
    undamped = np.array(
        [abs(x.real) <= e and _singular(own.A, 1j * x.imag) for x, e in zip(values, errors, strict=True)], dtype=bool
    )
    growing = values[~undamped & (values.real > 0.0)]
    if len(growing):
        worst = growing[np.argmax(growing.real)]
        return LargestGain(np.nan, np.nan, np.nan, f"the eigenvalue {_text(worst)} is unstable")
    if np.any(undamped):
        k = int(np.flatnonzero(undamped)[0])
        at = complex(0.0, values[k].imag if abs(values[k].imag) > errors[k] else 0.0)
        return LargestGain(np.inf, abs(at.imag), 0.0, f"the eigenvalue {_text(at)} has no damping")
    if np.any(own.D[1:]):
        return LargestGain(np.inf, np.inf, 0.0, "the output follows the rate of the input")
    return _level_sets(own, values)


def _text(value: complex) -> str:
    pair = f" ± {abs(value.imag):.6g}i" if value.imag else ""
    return f"{value.real:.6g}{pair}"


def _level_sets(channel: Channel, poles: Complex) -> LargestGain:
    """Return the largest gain of a stable channel: levels rise until none of their frequencies is left."""
    omega = np.concatenate([[0.0], np.abs(poles), np.abs(poles.imag)])
    sizes = np.abs(channel.at(omega))
    best = int(np.argmax(sizes))
    at, gamma = (
        (float(omega[best]), float(sizes[best]))
        if sizes[best] > abs(channel.D[0])
        else (np.inf, abs(float(channel.D[0])))
    )
    if gamma == 0.0:
        return LargestGain(0.0, 0.0, 0.0, "")
    # Rounding of A changes gains by this, where a sharp resonance is the largest.
    nearest = min((_smallest(channel.A, 1j * p.imag) for p in poles.tolist()), default=np.inf)
    rounding = TOLERANCES.roundings_of_zeros * EPS * float(np.linalg.norm(channel.A)) / nearest
    tolerance = max(TOLERANCES.level_step, rounding)
    while True:
        values = _level_values(channel, gamma * (1.0 + tolerance))
        crossed = np.sort(np.abs(values[np.abs(values.real) <= TOLERANCES.crossing_search * np.abs(values)].imag))
        # Between two crossings of a level the gain is above it somewhere.
        tried = np.concatenate([crossed, 0.5 * (crossed[1:] + crossed[:-1])])
        sizes = np.abs(channel.at(tried))
        if not np.max(sizes, initial=0.0) > gamma * (1.0 + tolerance):
            return LargestGain(*_summit(channel, gamma, at), tolerance, "")
        best = int(np.argmax(sizes))
        at, gamma = float(tried[best]), float(sizes[best])


def _summit(channel: Channel, gamma: float, at: float) -> tuple[float, float]:
    """Return a largest gain and its frequency, improved near it."""
    from scipy.optimize import minimize_scalar

    if not 0.0 < at < np.inf:
        return gamma, at
    near = (1.0 - TOLERANCES.summit) * at, (1.0 + TOLERANCES.summit) * at
    found = minimize_scalar(lambda x: -abs(channel.at(np.array([x]))[0]), bounds=near, options={"xatol": 1e-9 * at})
    better = -float(found.fun)
    return (better, float(found.x)) if better > gamma else (gamma, at)
