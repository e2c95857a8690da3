"""Eigenvalues of the linearized equations with error bounds and a verdict.

The default method deflates: the constraints first (`mbstab.analysis.linear.linearize`), then the
directions of symmetries and families that are verified by structure (`mbstab.analysis.verdict.neutral`), so
that they do not spoil small physical eigenvalues. The others are enclosed in discs that hold for
clusters and defective eigenvalues as well (`mbstab.analysis.bounds.location`). The verdict on stability
follows from the rule of `mbstab.analysis.verdict.rule`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex, Index
from mbstab.analysis.algebra.budget import Cost
from mbstab.analysis.algebra.sparse import in_sparse, product, scaled
from mbstab.analysis.algebra.tolerances import EPS
from mbstab.analysis.bounds.discs import Placed
from mbstab.analysis.bounds.location import enclosures_of
from mbstab.analysis.linear.linearize import Linearization, linearize
from mbstab.analysis.linear.methods import DEFAULT, METHODS, Found, solver
from mbstab.analysis.reference.nearby import closeness, symmetric_decimals
from mbstab.analysis.reference.requested import fits_sparse, reference_motion
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.spectrum.named_motions import Telling, Told, Whirl, mirrored
from mbstab.analysis.spectrum.results import Counts, EigenResult, Eigenvalue
from mbstab.analysis.spectrum.states_alone import at_rest_beside_states
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.many_digits import ManyDigits
from mbstab.analysis.verdict.rule import (
    STABLE,
    STABLE_UP_TO,
    UNDECIDED,
    UNSTABLE,
    Disc,
    Facts,
    IfSymmetric,
    Verdict,
    judge,
    place,
)
from mbstab.analysis.verdict.spectrum import Neutral
from mbstab.analysis.verdict.wording import show
from mbstab.compiler.system import Array, System
from mbstab.errors import MassError, MbstabError, NumericalError, UsageError, counted
from mbstab.model.literals import with_literals
from mbstab.model.schema import is_state
from mbstab.model.values import evaluate


def eigenvalues(linear: Linearization, method: str = DEFAULT, digits: ManyDigits | None = None) -> EigenResult:
    """Return the eigenvalues of the linearized equations with bounds and a verdict.

    Parameters
    ----------
    linear : Linearization
    method : str
        A name of `mbstab.analysis.linear.methods.METHODS`.
    digits : ManyDigits, optional
        The same motion with many digits (`mbstab.analysis.spectrum.exactly.Exactly`); asked only if the verdict
        depends on it.

    Raises
    ------
    UsageError
        If the method is unknown, or not applicable to this motion.
    NumericalError
        If the method needs independent constraint rows and they are not.
    """
    return judged(Grounds(linear, digits), method)


def judged(grounds: Grounds, method: str = DEFAULT) -> EigenResult:
    """Return the eigenvalues for facts that are already known; see `eigenvalues`."""
    if not isinstance(method, str) or method not in METHODS:
        raise UsageError(f"unknown method {method!r}\nhint: one of {', '.join(METHODS)}")
    linear, separated = grounds.linear, grounds.separated
    function = solver(method)
    if function is None:
        found, placed = None, grounds.enclosures()
        if not np.all(np.isfinite(placed.values)):
            raise NumericalError(
                "the eigenvalues left the range of double precision\n"
                "hint: look for numbers of extreme size in the file, or measure length, mass and time in other units"
            )
        neutral = separated.frequencies()
        neutral += [0j] * (separated.neutral.count - len(neutral))
    else:
        default = grounds.enclosures()
        known = [*separated.frequencies()]
        known += [0j] * (separated.neutral.count - len(known))
        found = function(linear, grounds.gamma, np.concatenate([default.values, known]))
        placed = enclosures_of(
            linear, grounds.space, grounds.gamma, grounds.S, separated.T, separated.L, found.values, found.vectors,
            separated.fitted,
        )  # fmt: skip
        neutral = [complex(placed.values[i]) for i in placed.neutral]
    return _result(grounds, placed, neutral, method, found)


def _result(
    grounds: Grounds, placed: Placed, neutral: Sequence[complex], method: str, found: Found | None
) -> EigenResult:
    """Return eigenvalues with their discs, and the verdict."""
    linear = grounds.linear
    spaces, centres = linear.motion.spaces, [d.centre for d in placed.discs]
    number = len(placed.values)
    discs = place(centres, [d.radius for d in placed.discs], [len(d.members) for d in placed.discs], grounds.mirrored)
    facts = grounds.facts(discs, number + (len(neutral) if found is None else 0))
    verdict = judge(facts)
    wider = _family_beside_growth(facts, verdict)
    if wider is not None:
        verdict = replace(verdict, zeros="neutral")
    listed: list[Eigenvalue] = []
    placed = _as_known(placed, bool(grounds.mirrored))
    modes = Modes(linear, placed)
    for disc, members in zip(discs, (d.members for d in placed.discs), strict=True):
        for i in members:
            kind = kind_in(complex(placed.values[i]), disc, verdict, grounds)
            listed.append(_eigenvalue(placed, i, kind, modes, len(members)))
    if verdict.zeros == "critical" and verdict.spectrum is not None:
        # A disc that holds zero may hold others, too: a count proves how many are zero.
        order = sorted((k for k, e in enumerate(listed) if e.kind == "critical"), key=lambda k: abs(listed[k].value))
        for k in order[verdict.spectrum.zeros :]:
            listed[k] = replace(listed[k], kind="undecided")
    listed = with_saddles(listed)
    listed += [Eigenvalue(s, "neutral", math.nan, math.nan, math.nan) for s in neutral]
    listed.sort(key=lambda e: (e.exact, -round(e.value.real, 12), abs(e.value.imag), -e.value.imag))
    besides = found or Found(np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex))
    light = linear.massless
    counts = Counts(
        linear.M.shape[0], grounds.system.n_h, grounds.system.n_n, spaces.C.rank, spaces.W.rank, linear.n_f,
        len(listed), sum(e.kind == "neutral" for e in listed), besides.infinite, besides.undefined, besides.extra,
        besides.extra_error, massless=() if light is None else light.names,
        critical=sum(e.kind == "critical" for e in listed), states=len(grounds.system.states[0]),
    )  # fmt: skip
    frame = str(linear.generator) if linear.generator is not None and linear.generator.turns else ""
    shifts = tuple(s.imag for s in grounds.separated.frequencies() if s.imag > 0.0)
    return EigenResult(
        listed, verdict, counts, method, (*linear.motion.warnings, *inexact(listed), *verdict.warnings), frame,
        not linear.constant or linear.frozen, shifts, coordinates=tuple(linear.names), units=linear.system.units,
        neutral_directions=verdict.modulo.names or (wider or facts.neutral).names,
    )  # fmt: skip


def _as_known(placed: Placed, mirrored: bool) -> Placed:
    """Return eigenvalues without what their bounds do not tell from structure.

    Of a spectrum that is symmetric about the imaginary axis, values that are mirror images within their bounds become
    so. A pair whose imaginary part may be zero, but not its real part, counts as a double real eigenvalue.
    """
    values, bounds = placed.values.copy(), placed.bounds.copy()
    off = np.flatnonzero(np.abs(values.real) > bounds)
    if mirrored and len(off):
        images = -values[off].conj()
        apart = np.abs(images[:, None] - values[off])
        nearest = np.argmin(apart, axis=1)
        for k, n in enumerate(nearest.tolist()):
            reach = max(bounds[off[k]], bounds[off[n]])
            if k < n and nearest[n] == k and apart[k, n] <= 2.0 * reach:
                middle = 0.5 * (values[off[k]] + images[n])
                values[off[k]], values[off[n]] = middle, -middle.conjugate()
                bounds[off[[k, n]]] = reach
    real = off[np.abs(values.imag[off]) <= bounds[off]]
    bounds[real] += np.abs(values.imag[real])
    values.imag[real] = 0.0
    return replace(placed, values=values, bounds=bounds)


def _family_beside_growth(facts: Facts, verdict: Verdict) -> Neutral | None:
    """Return the neutral directions if a family of motions explains all zeros of a motion with others that grow."""
    zeros = sum(d.count for d in facts.discs if d.side == "open" and d.holds_zero)
    if verdict.word != UNSTABLE or not zeros or facts.doubts or facts.found != facts.expected:
        return None
    return facts.family(zeros)


def kind_in(s: complex, disc: Disc, verdict: Verdict, grounds: Grounds) -> str:
    """Return the type of singular point of an eigenvalue in a disc."""
    form = "focus" if s.imag else "node"
    if disc.side in ("left", "right"):
        return ("un" if disc.side == "right" else "") + f"stable {form}"
    if verdict.zeros and disc.holds_zero:
        return verdict.zeros
    held = s.imag and verdict.word in (STABLE, STABLE_UP_TO) and _both_ways(grounds)
    if (disc.side == "axis" and s.imag) or held:
        return "center"
    return "undecided"


def _both_ways(grounds: Grounds) -> bool:
    """Whether the linearized equations are the same backwards in time: then all eigenvalues lie on the axis if stable.

    So they are with a conserved energy, and about a rest where no force has a linear part in the speeds, as a cubic
    damper.
    """
    motion, system = grounds.motion, grounds.system
    if grounds.structure.work.conserved or np.any(motion.u):
        return grounds.structure.work.conserved
    from mbstab.analysis.spectrum.census import resting

    known = system.remember("resting", motion.q.tobytes(), lambda: resting(system, motion.q, motion.time, system.n_n))
    return known.conservative


def _eigenvalue(placed: Placed, i: int, kind: str, modes: Modes, together: int) -> Eigenvalue:
    s = complex(placed.values[i])
    # An eigenvalue that is proven to be on the axis is shown there; its error does not grow.
    value = complex(0.0 if kind == "center" else s.real + 0.0, s.imag + 0.0)  # no −0
    bound = float(placed.bounds[i]) if np.isfinite(placed.bounds[i]) else math.inf
    condition, backward_error = float(placed.condition[i]), float(placed.backward_error[i])
    shares, vector, motions = modes.of(i)
    whirl = modes.whirl.of(value, vector)
    return Eigenvalue(
        value, kind, bound, condition, backward_error, shares, None, vector, motions, whirl, "", None, together
    )


def with_energies(result: EigenResult, linear: Linearization) -> EigenResult:
    """Return eigenvalues with the energies of their modes.

    Those that cannot be told from zero have none, nor have modes of first-order states in which no body moves.
    """
    told = {
        i: e.vector
        for i, e in enumerate(result.eigenvalues)
        if e.vector is not None and e.error_bound < abs(e.value) and result.moves_bodies(e)
    }
    from mbstab.analysis.spectrum.mode_energy import mode_energies

    found = mode_energies(linear, [(_middle(result, result.eigenvalues[i]), vector) for i, vector in told.items()])
    energies = dict(zip(told, found, strict=True))
    return replace(result, eigenvalues=[replace(e, energy=energies.get(i)) for i, e in enumerate(result.eigenvalues)])


def _middle(result: EigenResult, e: Eigenvalue) -> complex:
    """Return the mean of an eigenvalue and of those that are not told apart from it: to it the vectors belong."""
    if e.together == 1:
        return e.value
    near = sorted((x.value for x in result.eigenvalues), key=lambda s: abs(s - e.value))
    return sum(near[: e.together]) / e.together


class Modes:
    """Bodies and coordinates that move in each mode; in large scenes conjugates share a vector."""

    def __init__(self, linear: Linearization, placed: Placed) -> None:
        self.placed, scale = placed, linear.spaces.scale
        motion = linear.motion
        telling = Telling.of(linear.system, motion.q, motion.sizes, lambda: scale[:, None] * linear.spaces.N)
        self.whirl = Whirl(linear.system, linear.motion, linear.generator)
        x = at_rest_beside_states(linear, placed.values, placed.bounds, placed.vectors)
        self._shares = participation(scaled(linear.M, scale, scale), linear.names, x)
        self._shapes = mode_shapes(scale[:, None] * x, linear.motion.sizes)
        self._told = telling.told(self._shapes)

    def of(self, i: int) -> tuple[dict[str, float], Complex | None, Told]:
        """Return the participation of the bodies, the shape of a mode, and the motions by which it is told."""
        placed = self.placed
        j = i if placed.column is None else int(placed.column[i])
        shape = self._shapes[j]
        shares = self._shares[j] if shape is not None else {}
        told = self._told[j]
        if placed.column is None or placed.values[i].imag >= 0.0 or shape is None:
            return shares, shape, told
        return shares, shape.conj(), mirrored(told)


def told_mode(linear: Linearization, value: complex, dq: Complex) -> tuple[Complex | None, Told]:
    """Return the shape of a mode that is alone in question, Δq of shape (n_q,), and the motions by which it is told."""
    scale, motion = linear.spaces.scale, linear.motion
    telling = Telling.of(linear.system, motion.q, motion.sizes, lambda: scale[:, None] * linear.spaces.N)
    bound = EPS * len(dq) * abs(value)
    x = at_rest_beside_states(linear, np.array([value]), np.array([bound]), dq[:, None] / scale[:, None])
    shape = mode_shapes(scale[:, None] * x, motion.sizes)[0]
    return shape, telling.told([shape])[0]


def mode_shapes(dq: Any, sizes: Array) -> list[Complex | None]:
    """Return modes scaled so that the coordinate that moves most, relative to its size, is 1; None if nothing moves.

    Parameters
    ----------
    dq : ndarray, shape (n_q, k)
        Modes as columns.
    sizes : ndarray, shape (n_q,)
        Characteristic sizes of the coordinates (m, rad).
    """
    moved = np.abs(dq) / sizes[:, None]
    most = np.max(moved, axis=0, initial=0.0)
    with np.errstate(all="ignore"):
        # The first of those that move equally, so that rounding does not decide.
        largest = np.argmax(moved >= (1.0 - 1e-9) * most, axis=0)
        columns = np.arange(dq.shape[1])
        shapes = (dq / dq[largest, columns]).astype(complex).T + 0.0
    shapes[columns, largest] = 1.0
    return [shape if 0.0 < size < math.inf else None for shape, size in zip(shapes, most.tolist(), strict=True)]


def participation(M: Any, names: Sequence[str], x: Any) -> list[dict[str, float]]:
    """Return for each mode the share of each body in its kinetic energy.

    Parameters
    ----------
    M : matrix, shape (n_q, n_q)
        In scaled coordinates.
    names : sequence of str
        Names of the coordinates.
    x : ndarray, shape (n_q, k)
        Δq in scaled coordinates, as columns.
    """
    energy = np.real(x.conj() * product(M, x))
    total = np.sum(energy, axis=0)
    bodies, starts = _bodies(tuple(names))
    shares = np.add.reduceat(np.where(total > 0.0, energy / np.where(total > 0.0, total, 1.0), 0.0), starts)
    return [dict(zip(bodies, mode, strict=True)) for mode in shares[: len(bodies)].T.tolist()]


@lru_cache(maxsize=8)
def _bodies(names: tuple[str, ...]) -> tuple[tuple[str, ...], Index]:
    """Return the bodies to which coordinates belong, and where those of each begin; then states, without energy."""
    owners = [name.partition(".")[0] for name in names]
    starts = [k for k, owner in enumerate(owners) if not k or owner != owners[k - 1]]
    return tuple(owners[k] for k in starts if not is_state(names[k])), np.array(starts, dtype=np.intp)


def answer(
    system: System,
    method: str = DEFAULT,
    frozen: bool = False,
    progress: Callable[[float], object] | None = None,
    digits: ManyDigits | None = None,
) -> EigenResult:
    """Return the eigenvalues of a scene at its reference motion, with bounds and a verdict.

    Parameters
    ----------
    system : System
    method : str
    frozen : bool
        Use the equations frozen at the reference time, in the coordinates of the file.
    progress : callable, optional
        Called with the fraction of the work that is done, where it takes long: periodic motions.
    digits : ManyDigits, optional
        As for `eigenvalues`.

    Raises
    ------
    MbstabError
        As `mbstab.analysis.reference.motion.reference_motion`.
    """
    if method == DEFAULT and not frozen and fits_sparse(system):
        found = _of_large(system, digits)
        if found is not None:
            return found
    period = system.scene.period
    motion = reference_motion(system, massless=period is None)
    if period is not None and not frozen:
        from mbstab.analysis.spectrum.periodic import periodic_answer

        if method != DEFAULT:
            message = f"--method {method} needs constant coefficients; a periodic motion has multipliers"
            raise UsageError(f"{message}\nhint: leave out --method")
        return periodic_answer(system, motion, float(period), progress)
    grounds = Grounds(linearize(system, motion, frozen), digits)
    found = judged(grounds, method)
    return replace(found, judged=replace(found.judged, if_symmetric=if_symmetric(grounds)))


def if_symmetric(grounds: Grounds) -> IfSymmetric | None:
    """Return the verdict of a scene within the digits of the file that has more symmetries; None: none is found."""
    linear, system = grounds.linear, grounds.system
    near = closeness(system)
    large = system.sparse or system.n_q > REFERENCE.searched_together
    if large or not near or linear.frozen or (linear.constant and not grounds.may_turn(near)):
        return None
    alone = grounds.invariance.alone
    texts = symmetric_decimals(alone)
    if texts is None:
        return None
    try:
        moved = System(evaluate(with_literals(system.scene.model, texts)))
        others = Grounds(linearize(moved, reference_motion(moved, massless=True)))
        # The simplest come first; later ones may be combinations.
        known = {name for name, _ in grounds.invariance.fields}
        names = dict.fromkeys(name for name, _ in others.invariance.fields if name not in known)
        more = others.invariance.alone.space.shape[1] - alone.space.shape[1]
        return IfSymmetric((*names,)[:more], judged(others).verdict) if names else None
    except MbstabError:
        return None


def _of_large(system: System, digits: ManyDigits | None) -> EigenResult | None:
    """Return the answer for a large scene at rest; None where dense matrices give more."""
    sparse, found = in_sparse(system), None
    affordable = Cost.of("modes", system.n_q, system.n_c).affordable
    try:
        found = eigenvalues(linearize(sparse, reference_motion(sparse)), DEFAULT, digits)
    except MassError:
        if not affordable:
            raise
    except (np.linalg.LinAlgError, RuntimeError) as error:  # from SciPy, where it cannot factor
        if isinstance(error, MbstabError) or not affordable:
            raise
    if found is None:
        return None
    # Many of which nothing can be said are no clearer with dense matrices, which take minutes for them.
    vague = sum(e.kind == "undecided" or e.error_bound == math.inf for e in found.eigenvalues if not e.exact)
    settled = found.verdict != UNDECIDED and not any(e.error_bound == math.inf for e in found.eigenvalues)
    return found if settled or not affordable or vague > TOLERANCES.vague_looked_at_again else None


def inexact(found: list[Eigenvalue], remedy: str = "; --precision gives more digits") -> tuple[str, ...]:
    """Return warnings about eigenvalues with few known digits, or with none."""
    unknown = sum(not e.exact and e.error_bound == math.inf for e in found)
    if unknown:
        return (f"no error bound could be computed for {counted(unknown, 'eigenvalue')}{remedy}",)
    few = [
        e
        for e in found
        if not e.exact
        and e.value.imag >= 0.0
        and TOLERANCES.relative_bound_warned * abs(e.value) < e.error_bound < abs(e.value)
    ]
    if not few:
        return ()
    worst = max(few, key=lambda e: e.error_bound / abs(e.value))
    others = f" (and {len(few) - 1} more, less so)" if len(few) > 1 else ""
    magnified = f"{worst.condition:.1e} times" if math.isfinite(worst.condition) else "without bound"
    return (
        f"the eigenvalue {show(worst.value)} 1/s{others} is known to {worst.error_bound:.1e} 1/s only: "
        f"the rounding of the data and of the equations is magnified {magnified}{remedy}",
    )


def with_saddles(found: list[Any]) -> list[Any]:
    """Pair real eigenvalues of opposite sign, in any arithmetic: two such directions form a saddle."""
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
