"""Eigenvalues of the linearized equations, how far each can be trusted, and what they say.

The default method deflates: the constraints first (`mbstab.analysis.linearize`), then the
zero eigenvalues by a staircase null(S), null(S₂₂), … of orthogonal steps with rank gaps, so
that neutral directions do not spoil small physical eigenvalues. Each remaining eigenvalue
is judged on the undeflated quadratic eigenproblem (s²M̄ + sR̄ + K̄) x = 0 with right and left
vectors x, y: backward error η and condition number κ as in Tisseur (2000), Linear Algebra
Appl. 309, sections 2.2-2.3; κ·(η + rounding of the matrices) bounds the error to first order.
Where symmetries hold zero eigenvalues at zero, κ is the condition number in the deflated matrix:
disturbances that would move these zeros do not occur. The null vectors of other zeros are turned
by rounding, and the more the closer other eigenvalues are; that counts, unless it is measured.
Eigenvalues whose bound exceeds a hundred roundings are refined on that problem (`mbstab.analysis.refine`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from mbstab.analysis.linearize import Linearization, StateSpace, composite, linearize, reduced, state_space
from mbstab.analysis.methods import DEFAULT, METHODS, Found, solver
from mbstab.analysis.numerics import assigned
from mbstab.analysis.reference import reference_motion
from mbstab.analysis.refine import ROUNDINGS, Quadratic, equilibration, refined
from mbstab.analysis.steady import Generator
from mbstab.analysis.subspaces import rank_of
from mbstab.analysis.symmetry import Symmetry, conserved, symmetries
from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError
from mbstab.model.schema import is_length

Complex = npt.NDArray[np.complex128]

EPS = float(np.finfo(float).eps)
DATA = 2.0 * EPS
"""To what the matrices are known, relative to their norms: computed from data in double precision."""

NEUTRAL_ROUNDING = 30.0
"""A singular value of S is zero if it is no larger than this many roundings …"""

NEUTRAL_GAP = 1e3
"""… and the decision is trusted if the next one is larger than those by this factor."""

RANK_ROUNDING = 1e-12
"""A shift and a rate along symmetries satisfy the constraints if they do it to this."""

SLOW = 1e-3
"""Where it is not trusted, eigenvalues smaller than this fraction of the typical rate are in doubt."""

LONGEST_CHAIN = 3
"""A place that drifts because an angle drifts because a rate is constant: longer chains no symmetry explains."""

ADVICE = (
    "if it follows a symmetry, declare it with reference.steady; if it is periodic, give reference.period; "
    "or describe the motion so that it stands still"
)

TOLD = 0.1
"""An eigenvalue is told from zero if its error bound is no larger than this part of it."""

INDEPENDENT = 1e3
"""Equal eigenvalues whose vectors are better conditioned than this are no chain."""

APART = 1e-8
"""Eigenvalues smaller than this part of the largest have lost half of their digits in the matrix."""

FEW = 1e-10
"""Eigenvalues with larger relative error bounds are warned about."""

KNOWN = 1e-3
"""An eigenvalue known worse than this, relative to itself, is on neither side of the imaginary axis, nor on it."""

WEAK = 1e-3
"""Constraints with smaller singular values nearly depend on each other: the rounding of coordinates counts."""

ROUGH = 100.0 * EPS
"""Eigenvalues with larger relative error bounds are refined."""

MEASURED = 10.0
"""The error of one eigenvalue that its distance to another approximation measures is this many times that."""

CLUSTER = 100.0
"""The first-order bound is trusted for eigenvalues whose distance to the next is this many bounds."""


@dataclass(frozen=True)
class Eigenvalue:
    """One finite eigenvalue.

    Attributes
    ----------
    value : complex (1/s)
    kind : str
        ``stable node``, ``unstable node``, ``saddle``, ``stable focus``, ``unstable focus``,
        ``center``, ``neutral`` (zero), or ``undecided``.
    error_bound : float (1/s)
        κ·(η + rounding of the data); nan for neutral eigenvalues, which are exact zeros of the structure.
    condition, backward_error : float
        Relative condition number κ and backward error η.
    participation : dict
        Share of each body in the kinetic energy of the mode; sums to 1.
    multiplier : complex or None
        Of a periodic motion: what a disturbance is multiplied by in a period; `value` is then
        the Floquet exponent.
    """

    value: complex
    kind: str
    error_bound: float
    condition: float
    backward_error: float
    participation: dict[str, float] = field(default_factory=dict)
    multiplier: complex | None = None

    @property
    def frequency(self) -> float:
        """Frequency of oscillation |Im s|/2π (Hz)."""
        return abs(self.value.imag) / (2.0 * math.pi)

    @property
    def damping_ratio(self) -> float:
        """−Re s/|s|, nan for a neutral eigenvalue."""
        return -self.value.real / abs(self.value) if self.kind != "neutral" and self.value else math.nan

    @property
    def time_to_double(self) -> float:
        """Time in which a disturbance doubles (s); negative: the time in which it halves; inf if it does neither."""
        if self.kind in ("center", "neutral") or self.value.real == 0.0:
            return math.inf
        return math.log(2.0) / self.value.real


@dataclass(frozen=True)
class Counts:
    """Sizes of the problem.

    Attributes
    ----------
    n_q, n_holonomic, n_nonholonomic : int
        Coordinates and constraint rows.
    rank_holonomic, rank_nonholonomic : int
        rank C_q and rank D_u N.
    expected, found : int
        Finite eigenvalues: 2(n_q − rank C_q) − rank(D_u N), and what the method returned.
    neutral : int
        How many of them are zero.
    infinite, undefined : int
        Infinite eigenvalues and 0/0 pairs that the method returned besides.
    extra : int
        Eigenvalues of constraint drift that the method returned besides: two for each independent
        holonomic row, one for each nonholonomic one.
    extra_error : float (1/s)
        How far the worst of them came out from where it belongs: from 0, or from ±iω where a
        turning frame carries the constraint around.
    """

    n_q: int
    n_holonomic: int
    n_nonholonomic: int
    rank_holonomic: int
    rank_nonholonomic: int
    expected: int
    found: int
    neutral: int
    infinite: int
    undefined: int
    extra: int = 0
    extra_error: float = 0.0

    @property
    def degrees_of_freedom(self) -> int:
        """Number of independent speeds."""
        return self.n_q - self.rank_holonomic - self.rank_nonholonomic


@dataclass(frozen=True)
class EigenResult:
    """Eigenvalues, verdict and what they rest on.

    Attributes
    ----------
    eigenvalues : list of Eigenvalue
        Sorted by decreasing real part, neutral ones last.
    verdict : str
        ``asymptotically stable``, ``marginally stable``, ``unstable`` or ``undecided``.
    reasons : tuple of str
        What decides the verdict, in words.
    counts : Counts
    chains : tuple of int
        Sizes of the steps of the neutral staircase: how many zero eigenvalues have a vector,
        how many a second one in their chain, …
    symmetries : tuple of str
        Symmetries of the scene, which explain neutral eigenvalues.
    method : str
    warnings : tuple of str
    frame : str
        Where the equations stand still, in words; empty: in the coordinates of the file.
    shifts : tuple of float
        ω of neutral pairs ±iω: shifts that a turning frame carries around.
    period : float or None
        Of a periodic motion, judged by its Floquet multipliers (s).
    frozen : bool
        Whether these are frozen-time eigenvalues, which say nothing about stability.
    """

    eigenvalues: list[Eigenvalue]
    verdict: str
    reasons: tuple[str, ...]
    counts: Counts
    chains: tuple[int, ...]
    symmetries: tuple[str, ...]
    method: str
    warnings: tuple[str, ...]
    frame: str = ""
    frozen: bool = False
    shifts: tuple[float, ...] = ()
    period: float | None = None

    def values(self) -> Complex:
        """Return the eigenvalues that are not neutral, shape (n,)."""
        return np.array([e.value for e in self.eigenvalues if e.kind != "neutral"], dtype=complex)


@dataclass(frozen=True)
class Deflated:
    """A matrix in which the neutral eigenvalues are separated: Qᵀ S Q = [[neutral, T], [0, S_r]].

    `size` is its norm, `steps` are the zero eigenvalues in the steps of the staircase, `pairs`
    the frequencies of neutral pairs: shifts seen from a turning frame. The first `exact` columns
    of Q come from symmetries, not from S, so they do not bear its rounding. `unexplained` is how
    many zero eigenvalues no symmetry explains: they may be slow ones that rounding hides.
    """

    Q: Array
    neutral: Array
    coupling: Array
    S: Array
    steps: tuple[int, ...]
    size: float
    dropped: float
    undecided: str
    pairs: tuple[float, ...] = ()
    exact: int = 0
    unexplained: int = 0

    @property
    def n_neutral(self) -> int:
        """Number of neutral eigenvalues."""
        return sum(self.steps) + 2 * len(self.pairs)

    def neutral_values(self) -> list[complex]:
        """Return the neutral eigenvalues: zeros, then pairs."""
        pairs = [complex(0.0, sign * frequency) for frequency in self.pairs for sign in (1.0, -1.0)]
        return [0j] * sum(self.steps) + pairs


def deflate_neutral(S: Array, rounding: float = EPS, null: Array | None = None) -> Deflated:
    """Separate the zero eigenvalues of S by the staircase null(S), null(S₂₂) and so on.

    Parameters
    ----------
    S : ndarray, shape (n, n)
        Scaled so that its blocks are of similar size.
    rounding : float
        To what S is known, relative to its norm.
    null : ndarray, shape (n, k), optional
        Orthonormal basis of null(S) where that is known better.
    """
    n = len(S)
    Q, T = np.eye(n), S.copy()
    done, steps, dropped, undecided = 0, [], 0.0, ""
    size = float(np.linalg.norm(S, 2)) if n else 0.0
    if null is not None:
        n_null = null.shape[1]
        if not n_null:
            return Deflated(Q, T[:0, :0], T[:0], T, (), size, dropped, undecided)
        complement = np.linalg.svd(null)[0][:, n_null:]
        Q, T = _null_vectors_first(Q, T, np.vstack([complement.T, null.T]), 0, n_null)
        dropped = float(np.linalg.norm(T[:, :n_null], 2))
        T[:, :n_null] = 0.0
        steps.append(n_null)
        done = n_null
    while done < n:
        _, s, right = np.linalg.svd(T[done:, done:])
        zeros = int(np.sum(s <= NEUTRAL_ROUNDING * rounding * size))
        if zeros == 0:
            break
        if null is not None and zeros > steps[-1]:
            # A chain has no more vectors in its next step than in the one before.
            undecided = (
                f"{_count(zeros)} close to zero where {steps[-1]} at most can be: "
                "neutral or merely slow cannot be told in double precision"
            )
            break
        largest, next_one = float(s[-zeros]), float(s[-zeros - 1]) if zeros < len(s) else math.inf
        if not undecided and next_one < NEUTRAL_GAP * largest:
            undecided = (
                f"{_count(zeros)} close to zero without a gap (singular values {largest:.1e} and {next_one:.1e} 1/s): "
                "neutral or merely slow cannot be told in double precision"
            )
        dropped = max(dropped, largest)
        Q, T = _null_vectors_first(Q, T, right, done, zeros)
        T[done:, done : done + zeros] = 0.0
        steps.append(zeros)
        done += zeros
    return Deflated(Q, T[:done, :done], T[:done, done:], T[done:, done:], tuple(steps), size, dropped, undecided)


def deflate_symmetries(
    S: Array, rounding: float, linear: Linearization, space: StateSpace, gamma: float, known: list[Symmetry]
) -> Deflated | None:
    """Separate the zero eigenvalues that symmetries explain, then those that the staircase finds in the rest.

    Disturbances that are a shift along symmetries and a rate along them satisfy the equations where
    their accelerations are of that kind as well: going further, another heading, another speed.
    Nothing of S is needed to know them, so that its rounding does not turn them.

    Returns
    -------
    Deflated or None
        None if symmetries explain none or leave a doubt.
    """
    spaces, n, q = linear.motion.spaces, space.n_xi, linear.motion.q
    shifts = [s.direction / spaces.scale for s in known if s.exact and not _carried(linear.generator, q, s)]
    if not shifts:
        return None
    W = spaces.N.T @ np.array([w / np.linalg.norm(w) for w in shifts]).T
    P, Z = space.A[:n, :n], spaces.Z
    # Shifts W a and rates W b for which W b = P W a + Z η has a solution η.
    off = W - Z @ (Z.T @ W), P @ W - Z @ (Z.T @ (P @ W))
    lengths = max(float(np.linalg.norm(P, 2)) if n else 0.0, 1.0)
    both = _kernel(np.hstack([off[1] / lengths, -off[0]]), RANK_ROUNDING)
    if both is None:
        return None
    both[: W.shape[1]] /= lengths
    shift, rate = W @ both[: W.shape[1]], W @ both[W.shape[1] :]
    # They must become shifts W b with rates 0.
    states = np.vstack([shift, Z.T @ (rate - P @ shift) / gamma])
    images = np.vstack([rate, -Z.T @ (P @ rate) / gamma])
    left, s, right = np.linalg.svd(states, full_matrices=False)
    large = s > 1e-9 * np.max(s, initial=0.0)
    V, weights = left[:, large], right[large].T / s[large]
    size = float(np.linalg.norm(S, 2))
    known_to = NEUTRAL_ROUNDING * rounding * size
    # Such a shift must satisfy the constraints without a rate.
    drift = (P @ rate - Z @ (Z.T @ (P @ rate))) / gamma
    kept = _kernel(np.vstack([S @ V - images @ weights, drift @ weights]), known_to)
    if kept is None or not kept.shape[1]:
        return None
    V, rate = V @ kept, rate @ weights @ kept
    count = V.shape[1]
    second = int(np.linalg.matrix_rank(rate, tol=1e-12 * (float(np.linalg.norm(rate, 2)) or 1.0)))
    steps = [count - second, second] if second else [count]
    Q = np.linalg.svd(V)[0]
    Q[:, :count] = V
    T = Q.T @ S @ Q
    A = T[:count, :count]
    if np.linalg.norm(T[count:, :count], 2) > known_to or np.linalg.norm(A @ A, 2) > known_to * size:
        return None
    dropped = float(np.linalg.norm(T[count:, :count], 2))
    T[count:, :count] = 0.0
    rest = T[count:, count:]
    more = deflate_neutral(rest, rounding * size / (float(np.linalg.norm(rest, 2)) or 1.0) if len(rest) else rounding)
    turn = np.eye(len(S))
    turn[count:, count:] = more.Q
    Q, T = Q @ turn, turn.T @ T @ turn
    done = count + more.n_neutral
    T[count + more.n_neutral :, count:done] = 0.0
    for i, zeros in enumerate(more.steps):
        steps[i : i + 1] = [zeros + (steps[i] if i < len(steps) else 0)]
    return Deflated(
        Q, T[:done, :done], T[:done, done:], T[done:, done:], tuple(steps), size, max(dropped, more.dropped),
        more.undecided, (), count,
    )  # fmt: skip


def _kernel(matrix: Array, rounding: float) -> Array | None:
    """Return an orthonormal basis of what a matrix makes no larger than the rounding; None where that is in doubt."""
    _, s, right = np.linalg.svd(matrix)
    rank = int(np.sum(s > rounding))
    if rank and s[rank - 1] < NEUTRAL_GAP * rounding:
        return None
    result: Array = right[rank:].T
    return result


def _eig(S: Array) -> tuple[Complex, Complex]:
    """Return eigenvalues and vectors; slow ones that are lost beside fast ones come from the inverse of S."""
    values, vectors = (x.astype(complex) for x in np.linalg.eig(S))
    size = np.abs(values)
    order = np.argsort(-size)
    if size[order[-1]] > APART * size[order[0]]:
        return values, vectors
    try:
        inverse, others = (x.astype(complex) for x in np.linalg.eig(np.linalg.inv(S)))
    except np.linalg.LinAlgError:
        return values, vectors
    slow = np.argsort(-np.abs(inverse))
    if not np.isfinite(others).all() or inverse[slow[-1]] == 0.0:
        return values, vectors
    # The spectrum is parted where its gap is widest.
    rates = size[order]
    fast = 1 + int(np.argmax(rates[:-1] / np.maximum(rates[1:], EPS * rates[0])))
    fast_ones, slow_ones = order[:fast], slow[: len(S) - fast]
    return (
        np.concatenate([values[fast_ones], 1.0 / inverse[slow_ones]]),
        np.hstack([vectors[:, fast_ones], others[:, slow_ones]]),
    )


def null_space(linear: Linearization, space: StateSpace, gamma: float) -> Array | None:
    """Return null(S) as far as the single entries of the equations tell it, or None where they leave a doubt.

    Rows and columns of the equations before they are solved for the accelerations are scaled until their
    roundings are of one size: great damping hides no slow motion then, and great masses none that is held.

    Returns
    -------
    ndarray, shape (n_f, k) or None
        An orthonormal basis for the balanced S.
    """
    spaces = linear.motion.spaces
    n = space.n_xi
    weights = spaces.scale * spaces.scale[:, None]
    B = space.A.copy()
    P, N, Z = B[:n, :n], np.abs(spaces.N), np.abs(spaces.Z)
    M, R, K = (x * weights for x in (linear.M, linear.R, linear.K))
    _, *lower = reduced(M, R, K, spaces.N, spaces.Z, P)
    B[n:] = -np.hstack(lower)
    terms = linear.terms
    rows = terms.D_q * spaces.scale * spaces.row_scale[linear.n_h :, None]
    drift = np.abs(spaces.W.pseudo_inverse) @ rows @ N
    M, R, K = (x * weights for x in (terms.M, terms.R, terms.K))
    _, *lower = reduced(M, R, K, N, Z, drift)
    size = np.vstack([np.hstack([drift, Z]), np.hstack(lower)]) / min(1.0, spaces.C.smallest_kept)
    left, right = equilibration(size)
    _, s, vectors = np.linalg.svd(B * left[:, None] * right)
    known = EPS * float(np.linalg.norm(size * left[:, None] * right, 2))
    zeros = int(np.sum(s <= NEUTRAL_ROUNDING * known))
    if zeros < len(s) and s[-zeros - 1] < NEUTRAL_GAP * known:
        return None
    weights = np.ones(len(B))
    weights[n:] = gamma
    null = (right / weights)[:, None] * vectors[len(s) - zeros :].T
    return np.linalg.qr(null)[0] if zeros else null


def _null_vectors_first(Q: Array, T: Array, right: Array, done: int, count: int) -> tuple[Array, Array]:
    """Turn the columns after `done` so that the last `count` rows of `right` come first."""
    full = np.eye(len(T))
    full[done:, done:] = np.vstack([right[len(right) - count :], right[: len(right) - count]]).T
    return Q @ full, full.T @ T @ full


def deflate_pairs(deflated: Deflated, frequencies: list[float], rounding: float) -> Deflated:
    """Separate neutral pairs ±iω as well, in two steps at most: shifts and tilts, and drifts along them.

    Parameters
    ----------
    deflated : Deflated
    frequencies : list of float
        One ω for each pair of shifts that a turning frame carries around.
    rounding : float
        To what S is known, relative to its norm.
    """
    Q, done, pairs = deflated.Q, len(deflated.neutral), list(deflated.pairs)
    n = len(Q)
    T = np.zeros((n, n))
    T[:done, :done], T[:done, done:], T[done:, done:] = deflated.neutral, deflated.coupling, deflated.S
    for frequency in sorted(set(frequencies)):
        for _ in range(2):
            rest = T[done:, done:]
            if not len(rest):
                break
            _, s, right = np.linalg.svd(rest @ rest + frequency**2 * np.eye(len(rest)))
            size = deflated.size**2 + frequency**2
            # All null vectors: only the whole null space belongs to these eigenvalues.
            count = int(np.sum(s <= NEUTRAL_ROUNDING * rounding * size))
            if count == 0 or count % 2:
                break
            Q, T = _null_vectors_first(Q, T, right, done, count)
            T[done + count :, done : done + count] = 0.0
            done += count
            pairs += [frequency] * (count // 2)
    return replace(
        deflated, Q=Q, neutral=T[:done, :done], coupling=T[:done, done:], S=T[done:, done:], pairs=tuple(pairs)
    )


def carried_shifts(generator: Generator | None, q: Array, known: list[Symmetry]) -> list[float]:
    """Return ω if a turning frame carries symmetries around: ±iω are eigenvalues then, and neutral.

    A shift across the axis, or a tilt of it, is fixed in the ground and goes round in that frame.
    """
    carried = [s for s in known if _carried(generator, q, s)]
    return [abs(generator.rate)] if generator is not None and len(carried) >= 2 else []


def _carried(generator: Generator | None, q: Array, symmetry: Symmetry) -> bool:
    """Whether a turning frame carries a symmetry around."""
    if generator is None or not generator.turns:
        return False
    change, size = np.linalg.norm(generator.frame(q)[0] @ symmetry.direction), np.linalg.norm(symmetry.direction)
    return bool(change > 1e-9 * abs(generator.rate) * size)


def eigenvalues(
    linear: Linearization, method: str = DEFAULT, find_symmetries: Callable[[], list[Symmetry]] = list
) -> EigenResult:
    """Return the eigenvalues of the linearized equations with bounds and a verdict.

    Parameters
    ----------
    linear : Linearization
    method : str
        A name of `mbstab.analysis.methods.METHODS`.
    find_symmetries : callable, optional
        Returns the symmetries that explain neutral eigenvalues; called only if there are any.

    Raises
    ------
    UsageError
        If the method is unknown, or is not for this motion.
    NumericalError
        If the method needs independent constraint rows and they are not.
    """
    if method not in METHODS:
        raise UsageError(f"unknown method {method!r}\nhint: one of {', '.join(METHODS)}")
    space, gamma, deflated, rounding, known = deflate(linear, find_symmetries)
    judge = _Judge(linear, space, gamma, deflated, rounding)
    function = solver(method)
    if deflated.unexplained and not deflated.pairs:
        # Zeros of the matrix may be slow eigenvalues that the single entries of the equations still tell.
        other = _Judge(linear, space, gamma, held(linear, balanced(space, gamma), rounding, known), rounding)
        if (found := other.told()) is not None:
            judge = other
            if function is None:
                return judge.result(found, method, known)
    if function is None:
        return judge.result(judge.nullspace(), method, known)
    others = function(linear, gamma, judge.known())
    return judge.result(judge.undeflated(others.values, others.vectors), method, known, others)


def explained(linear: Linearization, known: list[Symmetry]) -> int:
    """Return how many zero eigenvalues symmetries explain: a place each, and a speed where momentum is kept."""
    system, motion = linear.system, linear.motion
    if not known or len(linear.D_q) or np.any(motion.u):
        return 2 * len(known)
    return len(known) + conserved(system, motion, known)


def held(linear: Linearization, S: Array, rounding: float, known: list[Symmetry]) -> Deflated:
    """Separate those zero eigenvalues of the balanced S alone that symmetries explain."""
    spaces = linear.motion.spaces
    n, limit = spaces.N.shape[1], NEUTRAL_ROUNDING * rounding * float(np.linalg.norm(S, 2))
    columns = np.zeros((len(S), len(known)))
    for k, symmetry in enumerate(known):
        shift = spaces.N.T @ (symmetry.direction / spaces.scale)
        columns[:n, k] = shift / (np.linalg.norm(shift) or 1.0)
    null = columns[:, np.linalg.norm(S @ columns, axis=0) <= limit]
    null = np.linalg.qr(null)[0]
    first = deflate_neutral(S, rounding, null)
    allowed = explained(linear, known) - null.shape[1]
    if first.steps[1:] and sum(first.steps[1:]) > allowed:
        return replace(first, unexplained=sum(first.steps[1:]) - allowed)
    return first


def deflate(
    linear: Linearization, find_symmetries: Callable[[], list[Symmetry]] = list
) -> tuple[StateSpace, float, Deflated, float, list[Symmetry]]:
    """Return the deflated system, a typical rate (1/s), its matrix without zeros, to what that is known, symmetries."""
    space = state_space(linear)
    gamma = time_scale(space)
    S = balanced(space, gamma)
    rounding = rounding_of(linear, space, gamma, S)
    deflated = deflate_neutral(S, rounding)
    fewer = False
    if deflated.steps:
        null = null_space(linear, space, gamma)
        if null is not None and null.shape[1] < deflated.steps[0]:
            fewer, deflated = True, deflate_neutral(S, rounding, null)
    known: list[Symmetry] = []
    turns = linear.generator is not None and linear.generator.turns
    if deflated.steps or turns:
        known = find_symmetries()
        better = None if fewer else deflate_symmetries(S, rounding, linear, space, gamma, known)
        # The staircase in S may miss zeros of a chain that come after a slow motion; never the reverse.
        if better is not None and better.undecided and not deflated.undecided:
            better = None
        if better is not None and better.n_neutral > deflated.n_neutral:
            deflated = better
        elif better is not None and better.n_neutral == deflated.n_neutral:
            deflated = replace(better, steps=deflated.steps, undecided=deflated.undecided or better.undecided)
        frequencies = carried_shifts(linear.generator, linear.motion.q, known)
        deflated = deflate_pairs(deflated, frequencies, rounding)
        zeros = sum(deflated.steps)
        deflated = replace(deflated, unexplained=max(0, zeros - explained(linear, known)) if zeros else 0)
    return space, gamma, deflated, rounding, known


def answer(
    system: System,
    method: str = DEFAULT,
    frozen: bool = False,
    progress: Callable[[float], object] | None = None,
) -> EigenResult:
    """Return the eigenvalues of a scene at its reference motion, with the symmetries that explain neutral ones.

    Parameters
    ----------
    system : System
    method : str
    frozen : bool
        Take the equations as they are at the reference time, in the coordinates of the file.
    progress : callable, optional
        Is called with the part of the work that is done, where that takes long: periodic motions.

    Raises
    ------
    MbstabError
        As `mbstab.analysis.motion.reference_motion`.
    """
    motion = reference_motion(system)
    period = system.scene.period
    if period is not None and not frozen:
        from mbstab.analysis.periodic import periodic_answer

        if method != DEFAULT:
            message = f"--method {method} is for constant coefficients; a periodic motion has multipliers"
            raise UsageError(f"{message}\nhint: leave out --method")
        return periodic_answer(system, motion, float(period), progress)
    return eigenvalues(linearize(system, motion, frozen), method, lambda: symmetries(system, motion))


def time_scale(space: StateSpace) -> float:
    """Return a typical rate of the deflated system (1/s)."""
    A, n = space.A, space.n_xi
    size = [
        math.sqrt(float(np.linalg.norm(A[n:, :n]))),
        float(np.linalg.norm(A[n:, n:])),
        float(np.linalg.norm(A[:n, :n])),
    ]
    return max(size, default=0.0) or 1.0


def balanced(space: StateSpace, gamma: float) -> Array:
    """Return S with speeds counted in units of γ: its blocks are of similar size."""
    weights = np.ones(len(space.A))
    weights[space.n_xi :] = gamma
    result: Array = space.A * weights / weights[:, None]
    return result


def rounding_of(linear: Linearization, space: StateSpace, gamma: float, S: Array) -> float:
    """Return to what the balanced S is known, relative to its norm: it is a difference of larger matrices."""
    scale = linear.motion.spaces.scale
    sizes = [float(np.linalg.norm(x * scale * scale[:, None], 2)) for x in (linear.M, linear.R, linear.K)]
    whole = gamma * sizes[0] + sizes[1] + sizes[2] / gamma
    size = float(np.linalg.norm(S, 2)) if len(S) else 0.0
    return EPS * (float(np.linalg.cond(space.M_z)) if space.M_z.size else 1.0) * max(1.0, whole / size if size else 1.0)


class _Judge:
    """Bounds, kinds and the verdict for eigenvalues of one linearization."""

    def __init__(
        self, linear: Linearization, space: StateSpace, gamma: float, deflated: Deflated, rounding: float
    ) -> None:
        self.linear, self.space, self.gamma, self.deflated, self.rounding = linear, space, gamma, deflated, rounding
        spaces = linear.motion.spaces
        self.n_neutral, self.doubtful = deflated.n_neutral, False
        # Composite matrices in scaled coordinates and rows, the rows as heavy as the stiffness.
        n = len(linear.M)
        M, R, K = linear.composite()
        scale = np.concatenate([spaces.scale, spaces.row_scale])
        M, R, K = (x * scale * scale[:, None] for x in (M, R, K))
        heavy = max(float(np.linalg.norm(K[:n, :n])), gamma * float(np.linalg.norm(R[:n, :n])), gamma * gamma)
        rows = np.ones(len(M))
        rows[n : n + linear.n_h] = heavy
        rows[n + linear.n_h :] = heavy / gamma
        self.M, self.R, self.K = (x * rows[:, None] * rows for x in (M, R, K))
        self.factors = scale * rows
        self.sizes = [float(np.linalg.norm(x, 2)) for x in (self.M, self.R, self.K)]
        self.n = n

    # --- eigenvectors -----------------------------------------------------------------------------------------------

    def nullspace(self) -> list[Eigenvalue]:
        """Return all finite eigenvalues from the deflated system."""
        values, right, left = self._deflated_vectors()
        neutral = [self._zero(s, i) for i, s in enumerate(self.deflated.neutral_values())]
        x, y = self._composite_vectors(values, right, left)
        return self._displaced(self._refined(self._judged(values, x, y), values, x, y), x, y) + neutral

    def told(self) -> list[Eigenvalue] | None:
        """Return all finite eigenvalues if those that are not neutral can be told from zero, or None."""
        self.doubtful = True
        try:
            with np.errstate(all="ignore"):
                found = self.nullspace()
        except np.linalg.LinAlgError:
            return None
        judged = [e for e in found if e.kind != "neutral"]
        return found if all(e.error_bound < TOLD * abs(e.value) for e in judged) else None

    def _zero(self, s: complex, number: int) -> Eigenvalue:
        """Return an eigenvalue that the staircase found to be neutral; what no symmetry explains may be slow."""
        d = self.deflated
        if number >= d.unexplained:
            return Eigenvalue(s, "neutral", math.nan, math.nan, math.nan)
        # Of a chain of length m one digit in m is left; the next eigenvalues are slow as well perhaps.
        length = max(2, len(d.steps))
        part = max(NEUTRAL_ROUNDING * self.rounding, d.dropped / d.size if d.size else 0.0)
        return Eigenvalue(s, "undecided", d.size * part ** (1.0 / length), math.inf, math.nan)

    @cache  # noqa: B019 - a judge lives as long as one answer
    def _deflated_vectors(self) -> tuple[Complex, Complex, Complex]:
        """Return eigenvalues with right and left vectors of S, as columns."""
        d = self.deflated
        n, k = len(d.Q), self.n_neutral
        if n == k:
            empty = np.zeros((n, 0), dtype=complex)
            return np.zeros(0, dtype=complex), empty, empty
        values, inner = _eig(d.S)
        try:
            dual = np.linalg.inv(inner).conj().T.astype(complex)
        except np.linalg.LinAlgError:
            dual = np.full_like(inner, np.nan)
        upper = np.zeros((k, n - k), dtype=complex)
        for j, s in enumerate(values):
            upper[:, j] = np.linalg.solve(s * np.eye(k) - d.neutral, d.coupling @ inner[:, j]) if k else 0.0
        right: Complex = d.Q @ np.vstack([upper, inner])
        left: Complex = d.Q @ np.vstack([np.zeros((k, n - k)), dual])
        return values, right, left

    def _composite_vectors(self, values: Complex, right: Complex, left: Complex) -> tuple[Complex, Complex]:
        """Return right and left vectors of the scaled quadratic problem from those of the balanced S."""
        spaces, space = self.linear.motion.spaces, self.space
        m = space.n_xi
        x_q = spaces.N @ right[:m]
        w = np.linalg.solve(space.M_z.T, left[m:]) if space.M_z.size else left[m:]
        y_q = spaces.N @ (spaces.Z @ w)
        x = np.vstack([x_q, self._multipliers(values, x_q, False)])
        y = np.vstack([y_q, self._multipliers(values, y_q, True)])
        for j in range(len(values)):
            if len(self.linear.D_q) and np.linalg.norm(left[m:, j]) <= 1e-10 * np.linalg.norm(left[:, j]):
                y[:, j] = self._kinematic_left_vector(complex(values[j]))
        return x, y

    def _kinematic_left_vector(self, s: complex) -> Complex:
        """Return the left vector of a mode that the nonholonomic rows alone decide: no forces, only rows of D."""
        spaces, n, n_h = self.linear.motion.spaces, self.n, self.linear.n_h
        D = s * self.R[n + n_h :, :n] + self.K[n + n_h :, :n]
        # Combinations of rows that vanish because rows repeat each other decide nothing.
        rows = rank_of(spaces.W.left_null.T).null
        left, _, _ = np.linalg.svd(rows.T @ D @ spaces.N, full_matrices=True)
        mu = rows @ left[:, -1]
        C = self.K[n : n + n_h, :n]
        lam = np.linalg.lstsq(C.T.astype(complex), -(D.conj().T @ mu), rcond=1e-13)[0] if n_h else np.zeros(0)
        return np.concatenate([np.zeros(n), lam, mu]).astype(complex)

    def _multipliers(self, values: Complex, vectors: Complex, left: bool) -> Complex:
        """Complete vectors with the multipliers that the first block row asks for, by least squares."""
        n, c = self.n, len(self.M) - self.n
        if c == 0:
            return np.zeros((0, len(values)), dtype=complex)
        n_h = self.linear.n_h
        s = values.conj() if left else values
        M, R, K = (x.T[:n] if left else x[:n] for x in (self.M, self.R, self.K))
        known = (M[:, :n] @ vectors) * s**2 + (R[:, :n] @ vectors) * s + K[:, :n] @ vectors
        if not left or n_h == c:  # the columns of the multipliers do not depend on s
            result: Complex = np.linalg.lstsq(K[:, n:].astype(complex), -known, rcond=1e-13)[0]
            return result
        columns = [np.linalg.lstsq(x * R[:, n:] + K[:, n:], -known[:, j], rcond=1e-13)[0] for j, x in enumerate(s)]
        return np.array(columns, dtype=complex).T.reshape(c, len(values))

    def known(self) -> Complex:
        """Return the eigenvalues of the deflated system."""
        return np.concatenate([self._deflated_vectors()[0], self.deflated.neutral_values()])

    def undeflated(self, values: Complex, vectors: Complex) -> list[Eigenvalue]:
        """Return eigenvalues of another method, judged with its own vectors and the deflated left ones."""
        if len(values) == 0:
            return []
        scale = np.concatenate([self.linear.motion.spaces.scale, self.linear.motion.spaces.row_scale])
        deflated, right, left = self._deflated_vectors()
        _, y = self._composite_vectors(deflated, right, left)
        neutral: set[int] = set()
        for s in self.deflated.neutral_values():
            free = [i for i in range(len(values)) if i not in neutral]
            neutral |= {min(free, key=lambda i: abs(values[i] - s))} if free else set()
        found: list[Eigenvalue] = []
        judged, columns = [], []
        for i in range(len(values)):
            if i in neutral:
                found.append(self._zero(complex(values[i]), len(found)))
                continue
            nearest = int(np.argmin(np.abs(deflated - values[i]))) if len(deflated) else -1
            x = vectors[: self.n, i] / scale[: self.n]
            x = np.concatenate([x, self._multipliers(values[i : i + 1], x[:, None], False)[:, 0]])
            other = y[:, nearest] if nearest >= 0 else np.full_like(x, np.nan)
            # Other methods do not know of the zeros: their eigenvalues bear disturbances that move them.
            off = abs(values[i] - deflated[nearest]) if nearest >= 0 else 0.0
            judged += self._judged(values[i : i + 1], x[:, None], other[:, None], zeros_held=False, least=off)
            columns.append((x, other))
        if not judged:
            return found
        right, left = (np.array(group).T for group in zip(*columns, strict=True))
        return found + self._displaced(judged, right, left)

    # --- refinement -------------------------------------------------------------------------------------------------

    def _refined(self, found: list[Eigenvalue], values: Complex, x: Complex, y: Complex) -> list[Eigenvalue]:
        """Make eigenvalues exact that bear the rounding of larger numbers than those that decide them."""
        rough = [i for i, e in enumerate(found) if not e.error_bound <= ROUGH * abs(values[i])]
        if not rough:
            return found
        problem, kept = self._quadratic()
        better: dict[int, tuple[complex, float, Complex]] = {}
        for i in rough:
            if values[i].imag < 0.0 or (pair := refined(problem, complex(values[i]), x[kept, i], y[kept, i])) is None:
                continue
            s, bound, vector = pair
            s = complex(s.real) if values[i].imag == 0.0 else s
            if self.n_neutral > self.deflated.exact and not self.deflated.unexplained:
                held = self._held(i, complex(values[i]), s, x, y)
                if held < min(bound, found[i].error_bound):
                    better[i] = complex(values[i]), held, x[: self.n, i] / np.linalg.norm(x[: self.n, i])
                    continue
            # Newton's method must not have gone to another eigenvalue, nor both of a pair to one that is real.
            if values[i].imag and _same((s, bound, vector), (s.conjugate(), bound, vector.conj())):
                continue
            if bound < found[i].error_bound and abs(s - values[i]) <= found[i].error_bound:
                better[i] = s, bound, vector[: self.n] / np.linalg.norm(vector[: self.n])
        lost = {i for i, one in better.items() for j, two in better.items() if i != j and _same(one, two)}
        result = list(found)
        for i, (s, bound, vector) in better.items():
            if i in lost:
                continue
            twins = [(i, s)]
            if s.imag:
                twins.append((min(rough, key=lambda j: abs(values[j] - values[i].conjugate())), s.conjugate()))
            for j, value in twins:
                kind = self._kind(value, bound)
                value = complex(value.real + 0.0, value.imag + 0.0)
                condition, energy = _relative(bound / DATA, s), self._participation(vector)
                result[j] = Eigenvalue(value, kind, bound, condition, 0.0, energy)
        return result

    def _displaced(self, found: list[Eigenvalue], x: Complex, y: Complex) -> list[Eigenvalue]:
        """Add to the bounds what the rounding of the coordinates makes of eigenvalues where constraints nearly depend.

        There a rounding of a constraint moves the coordinates by the inverse of a small singular value.
        """
        linear, spaces = self.linear, self.linear.motion.spaces
        if spaces.C.smallest_kept > WEAK or not found:
            return found
        motions, inverse, rows = np.linalg.svd(spaces.C.pseudo_inverse)
        motion, n_h = linear.motion, linear.n_h
        residual = motion.dynamics.E[:n_h] * spaces.row_scale[:n_h]
        known = DATA * (np.abs(linear.J[:n_h]) @ motion.sizes) * spaces.row_scale[:n_h]
        extra = np.zeros(len(found))
        for k in np.flatnonzero(inverse * WEAK > 1.0):
            far = float(inverse[k]) * (float(np.abs(rows[k]) @ known) + abs(float(rows[k] @ residual)))
            # Differences over a path on which the constraints are as weak as here.
            step = 1e-3 * float(np.min(motion.sizes / spaces.scale)) / float(inverse[k])
            there, back = (composite(linear.beside(sign * step * spaces.scale * motions[:, k])) for sign in (1.0, -1.0))
            M, R, K = (
                (a - b) * (far / (2.0 * step)) * self.factors * self.factors[:, None]
                for a, b in zip(there, back, strict=True)
            )
            for j, e in enumerate(found):
                if not math.isfinite(e.error_bound):
                    continue
                s = e.value
                slope = abs(y[:, j].conj() @ (2.0 * s * (self.M @ x[:, j]) + self.R @ x[:, j]))
                change = abs(y[:, j].conj() @ (s * s * (M @ x[:, j]) + s * (R @ x[:, j]) + K @ x[:, j]))
                extra[j] += change / slope if slope > 0.0 else math.inf
        result = []
        for e, more in zip(found, extra.tolist(), strict=True):
            bound, condition = e.error_bound + more, e.condition + _relative(more / DATA, e.value)
            kind = self._kind(e.value, bound)
            result.append(replace(e, error_bound=bound, condition=condition, kind=kind))
        return result

    def _quadratic(self) -> tuple[Quadratic, npt.NDArray[np.intp]]:
        """Return the composite problem in scaled coordinates without redundant rows, and what is left of its rows."""
        linear, n = self.linear, self.n
        redundant = [id(item.row) for item in linear.motion.redundant]
        kept = np.array([*range(n), *(n + i for i, row in enumerate(linear.rows) if id(row) not in redundant)])
        terms = [x * self.factors * self.factors[:, None] for x in composite(linear.terms)]
        M, R, K, *sizes = (x[np.ix_(kept, kept)] for x in (self.M, self.R, self.K, *terms))
        return Quadratic.of(M, R, K, tuple(sizes)), kept

    def _held(self, i: int, s: complex, refined: complex, x: Complex, y: Complex) -> float:
        """Return the error bound of an eigenvalue of the deflated matrix if its zeros are zeros of the structure.

        Then rounding does what it does to the rest of the matrix and to the single entries. How far the zeros
        were turned in finding them is measured: the refined eigenvalue does not know of them.
        """
        inner = float(self._deflated_condition(np.array([s]), self.n_neutral)[0]) * EPS
        M, R, K = (z * self.factors * self.factors[:, None] for z in composite(self.linear.entries))
        left, right, size = np.abs(y[:, i]), np.abs(x[:, i]), abs(s)
        slope = abs(y[:, i].conj() @ (2.0 * s * (self.M @ x[:, i]) + self.R @ x[:, i]))
        entries = ROUNDINGS * EPS * float(left @ ((size * size * M + size * R + K) @ right))
        turned = MEASURED * abs(s - refined)
        return max(inner, entries / slope + turned) if slope > 0.0 else math.inf

    # --- bounds -----------------------------------------------------------------------------------------------------

    def _judged(
        self, values: Complex, x: Complex, y: Complex, zeros_held: bool = True, least: float = 0.0
    ) -> list[Eigenvalue]:
        if len(values) == 0:
            return []
        size = np.abs(values)
        weight = size**2 * self.sizes[0] + size * self.sizes[1] + self.sizes[2]
        residual = (self.M @ x) * values**2 + (self.R @ x) * values + self.K @ x
        slope = np.abs(np.sum(y.conj() * (2.0 * (self.M @ x) * values + self.R @ x), axis=0))
        length_x, length_y = np.linalg.norm(x, axis=0), np.linalg.norm(y, axis=0)
        with np.errstate(all="ignore"):
            eta = np.linalg.norm(residual, axis=0) / (weight * length_x)
            kappa = weight * length_x * length_y / slope
            if self.n_neutral and zeros_held and not self.deflated.unexplained:
                kappa = self._deflated_condition(values, self.deflated.exact)
            bound = np.maximum(kappa * (eta + DATA), least)
        found = []
        for j, s in enumerate(values):
            error = float(bound[j]) if np.isfinite(bound[j]) else math.inf
            relative = _relative(float(kappa[j]), complex(s))
            kind = self._kind(complex(s), error)
            value = complex(s.real + 0.0, s.imag + 0.0)  # no −0
            found.append(Eigenvalue(value, kind, error, relative, float(eta[j]), self._participation(x[: self.n, j])))
        return found

    def _deflated_condition(self, values: Complex, held: int) -> Array:
        """Return absolute condition numbers (1/s) of eigenvalues in the matrix without its first `held` zeros.

        Rounding turns the null vectors of other zeros, so the shares of a mode along them count.
        """
        known, right, left = self._deflated_vectors()
        product = np.abs(np.sum(left.conj() * right, axis=0))
        others = self.deflated.Q[:, held:].T @ right
        condition = np.linalg.norm(others, axis=0) * np.linalg.norm(left, axis=0) / product
        # S is known to round-off, and zeros were separated by dropping something.
        size = max(self.deflated.size * self.rounding, self.deflated.dropped) / EPS
        nearest = [int(np.argmin(np.abs(known - s))) for s in values]
        result: Array = condition[nearest] * size
        return result

    def _kind(self, s: complex, bound: float) -> str:
        """Return the type of singular point; where few digits are known, nothing is taken to be on the axis."""
        kind = kind_of(s, bound, self._separation(s))
        close = bound <= (FEW if self.doubtful else KNOWN) * abs(s)
        return kind if kind != "center" or close else "undecided"

    def _separation(self, s: complex) -> float:
        """Return the distance of an eigenvalue to the next one, itself left out."""
        known, right, left = self._deflated_vectors()
        nearest = int(np.argmin(np.abs(known - s))) if len(known) else -1
        if nearest >= 0:
            x, y = right[:, nearest], left[:, nearest]
            if np.linalg.norm(x) * np.linalg.norm(y) < INDEPENDENT * abs(np.vdot(y, x)):
                return math.inf  # equal eigenvalues with vectors of their own do not disturb each other
        distance = np.sort(np.abs(known - s))
        others = [float(distance[1])] if len(distance) > 1 else []
        return min([*others, *(abs(s - other) for other in set(self.deflated.neutral_values())), math.inf])

    def _participation(self, x: Complex) -> dict[str, float]:
        """Return the share of each body in the kinetic energy of a mode."""
        M = self.M[: self.n, : self.n]
        energy = np.real(x.conj() * (M @ x))
        total = float(np.sum(energy))
        shares: dict[str, float] = {}
        for name, value in zip(self.linear.names, energy, strict=True):
            body = name.partition(".")[0]
            shares[body] = shares.get(body, 0.0) + (float(value) / total if total > 0.0 else 0.0)
        return shares

    # --- verdict ----------------------------------------------------------------------------------------------------

    def result(
        self, found: list[Eigenvalue], method: str, known: list[Symmetry], besides: Found | None = None
    ) -> EigenResult:
        linear = self.linear
        besides = besides or Found(np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex))
        found = with_saddles(_lost(found))
        found.sort(key=lambda e: (e.kind == "neutral", -round(e.value.real, 12), abs(e.value.imag), -e.value.imag))
        spaces = linear.motion.spaces
        counts = Counts(
            len(linear.M), linear.n_h, len(linear.J) - linear.n_h, spaces.C.rank, spaces.W.rank, linear.n_f, len(found),
            self.n_neutral, besides.infinite, besides.undefined, besides.extra, besides.extra_error,
        )  # fmt: skip
        verdict, reasons = self._verdict(found, counts, known)
        frame = str(linear.generator) if linear.generator is not None and linear.generator.turns else ""
        return EigenResult(
            found, verdict, tuple(reasons), counts, self.deflated.steps, tuple(s.name for s in known), method,
            linear.motion.warnings + _inexact(found), frame, not linear.constant, self.deflated.pairs,
        )  # fmt: skip

    def _accelerating(self) -> str:
        """Name the coordinate that accelerates most: a reference out of balance is the usual reason for a change."""
        motion = self.linear.motion
        size = np.abs(motion.a / motion.spaces.scale)
        if not np.any(size > 0.0):
            return ""
        worst = int(np.argmax(size))
        unit = "m/s^2" if is_length(self.linear.names[worst]) else "rad/s^2"
        return f" ({self.linear.names[worst]} accelerates with {motion.a[worst]:.4g} {unit})"

    def _verdict(self, found: list[Eigenvalue], counts: Counts, known: list[Symmetry]) -> tuple[str, list[str]]:
        doubts = []
        if not self.linear.constant:
            change = self.linear.variation
            size = f"by {change:.1%}" if math.isfinite(change) else "without bound"
            asked = " (asked for)" if self.linear.frozen else ""
            advice = "" if self.linear.frozen else f"{self._accelerating()}; {ADVICE}"
            doubts.append(
                f"frozen-time{asked}: not a stability verdict; the coefficients of the linearized equations change "
                f"{size} along the motion{advice}"
            )
        if counts.found != counts.expected:
            doubts.append(
                f"{counts.expected} finite eigenvalues exist, the method returned {counts.found}; "
                "use --method nullspace"
            )
        # Without a gap, what is slow may be neutral.
        slow = SLOW * self.gamma if self.deflated.undecided else 0.0
        growing = [e for e in found if e.kind in ("unstable node", "unstable focus", "saddle") and e.value.real > slow]
        if growing and not doubts:
            worst = max(growing, key=lambda e: e.value.real)
            plural, verb = ("s", "grow") if worst.value.imag else ("", "grows")
            return "unstable", [
                f"the eigenvalue{plural} {show(worst.value)} 1/s {verb} (error bound {worst.error_bound:.1e})"
            ]
        if self.deflated.undecided:
            doubts.append(self.deflated.undecided)
        if len(self.deflated.steps) > LONGEST_CHAIN:
            doubts.append(
                f"zero eigenvalues form a chain of length {len(self.deflated.steps)}, longer than symmetries explain: "
                "a critical state, which the linearized equations cannot judge"
            )
        elif self.deflated.unexplained:
            zeros, explain = sum(self.deflated.steps), "symmetry explains" if len(known) == 1 else "symmetries explain"
            most = f"{len(known)} {explain} {zeros - self.deflated.unexplained} at most"
            doubts.append(
                f"{_count(zeros)} zero, but {most}: a critical state or a continuum of equilibria, which the "
                "linearized equations cannot judge, or motions so slow that rounding hides them: zero to "
                f"{self._zero(0j, 0).error_bound:.1e} 1/s; --precision tells them apart"
            )
        for e in found:
            if e.kind == "undecided" and e.value.imag >= 0.0 and math.isfinite(e.condition + e.backward_error):
                doubts.append(
                    f"the eigenvalue {show(e.value)} 1/s lies within its error bound {e.error_bound:.1e} of the "
                    "imaginary axis or too close to another one to be placed on it "
                    f"(condition number {e.condition:.1e})"
                )
        if not counts.expected:
            doubts.append("constraints and drives leave no motion free whose stability could be judged")
        if doubts:
            return "undecided", doubts
        centers = sum(e.kind == "center" for e in found)
        widest = max((e.error_bound for e in found if e.kind == "center"), default=0.0)
        if centers:
            return "marginally stable", [
                f"{centers} eigenvalues lie on the imaginary axis within {widest:.0e} 1/s, none to the right of it: "
                "whether disturbances stay small in the long run is up to nonlinear terms"
            ]
        if self.n_neutral:
            what = "neutral, the others decay" if counts.found > self.n_neutral else "neutral"
            return "marginally stable", [f"{_count(self.n_neutral)} {what}"]
        return "asymptotically stable", ["all eigenvalues lie to the left of the imaginary axis"]


def kind_of(s: complex, bound: float, separation: float) -> str:
    """Return the type of singular point; `separation` is the distance to the nearest other eigenvalue."""
    real = s.imag == 0.0
    clustered = not bound * CLUSTER < separation
    # Nearly multiple eigenvalues move by the root of a disturbance, not by the first-order bound.
    margin = max(bound, 10.0 * separation, math.sqrt(EPS) * abs(s)) if clustered else bound
    if abs(s.real) > margin:
        return ("un" if s.real > 0 else "") + ("stable node" if real else "stable focus")
    return "undecided" if clustered or real or bound > KNOWN * abs(s) else "center"


def _lost(found: list[Eigenvalue]) -> list[Eigenvalue]:
    """Give eigenvalues of which no digit is known one bound: they stand for each other, and vectors say nothing."""
    lost = [e for e in found if e.kind != "neutral" and e.error_bound > abs(e.value)]
    if len(lost) < 2:
        return found
    ids, bound = {id(e) for e in lost}, max(e.error_bound for e in lost)
    return [replace(e, error_bound=bound, kind="undecided") if id(e) in ids else e for e in found]


def _inexact(found: list[Eigenvalue]) -> tuple[str, ...]:
    """Return a warning about eigenvalues of which few digits are known, or nothing."""
    few = [
        e
        for e in found
        if e.kind != "neutral" and e.value and e.value.imag >= 0.0 and e.error_bound > FEW * abs(e.value)
    ]
    if not few:
        return ()
    worst = max(few, key=lambda e: _relative(e.error_bound, e.value))
    others = f" (and {len(few) - 1} more, less so)" if len(few) > 1 else ""
    return (
        f"the eigenvalue {show(worst.value)} 1/s{others} is known to {worst.error_bound:.1e} 1/s only: "
        f"the rounding of the data and of the equations is magnified {worst.condition:.1e} times; "
        "--precision gives more digits",
    )


def _relative(error: float, s: complex) -> float:
    """Return an error relative to the size of an eigenvalue."""
    return error / abs(s) if s else math.inf


def _same(one: tuple[complex, float, Complex], two: tuple[complex, float, Complex]) -> bool:
    """Whether two refined eigenpairs are one: equal values are multiple only if their vectors are independent."""
    (s, known, x), (t, also, y) = one, two
    return abs(s - t) <= known + also and bool(
        abs(np.vdot(x, y)) > (1.0 - 1e-6) * np.linalg.norm(x) * np.linalg.norm(y)
    )


def with_saddles(found: list[Any]) -> list[Any]:
    """Pair real eigenvalues of opposite sign, with whatever digits: two such directions form a saddle."""
    growing = [e for e in found if e.kind == "unstable node"]
    decaying = [e for e in found if e.kind == "stable node"]
    saddles: set[int] = set()
    for e in growing:
        partner = min(
            (d for d in decaying if id(d) not in saddles), key=lambda d: abs(d.value.real + e.value.real), default=None
        )
        if partner is not None:
            saddles |= {id(e), id(partner)}
    return [replace(e, kind="saddle") if id(e) in saddles else e for e in found]


def _count(number: int) -> str:
    return f"{number} eigenvalue{' is' if number == 1 else 's are'}"


def show(s: complex) -> str:
    """Return an eigenvalue with six significant digits; a pair as ±."""
    return f"{s.real:.6g}" if s.imag == 0.0 else f"{s.real:.6g} ± {abs(s.imag):.6g}i"


def matched(found: Any, expected: Any) -> Array:
    """Return |found − expected| after the pairing that makes the sum smallest.

    Parameters
    ----------
    found, expected : array_like of complex, the same number

    Notes
    -----
    Sorting complex numbers pairs them wrongly when real parts differ by round-off.
    """
    found, expected = np.asarray(found, dtype=complex), np.asarray(expected, dtype=complex)
    distance = np.abs(found[:, None] - expected[None, :])
    result = np.empty(len(expected))
    columns = assigned(distance)
    result[columns] = distance[np.arange(len(found)), columns]
    return result
