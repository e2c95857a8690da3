"""All methods on one model: their cost, and their errors against eigenvalues known to many digits.

The truth is computed from the same model in multiprecision arithmetic, its parameters the exact decimals of
the file, so an error is a distance from the truth and not from another method. Part of it
cannot be avoided in double precision: parameters and matrices are rounded before a method starts.
The exact eigenvalues of the rounded matrices are computed as well; the distance
from those is the method's own error.
"""

from __future__ import annotations

import cProfile
import math
import statistics
import time
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np

from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.algebra.subspaces import subspaces
from mbstab.analysis.compare.tolerances import TOLERANCES
from mbstab.analysis.linear.linearize import Linearization, linearize, state_space
from mbstab.analysis.linear.methods import METHODS, solver
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.spectrum.eigenvalues import judged
from mbstab.analysis.spectrum.exactly import Exactly
from mbstab.analysis.spectrum.precise import PreciseResult, precise_eigenvalues, rounded_eigenvalues
from mbstab.analysis.spectrum.tolerances import TOLERANCES as SPECTRUM
from mbstab.analysis.verdict.directions import Deflated
from mbstab.analysis.verdict.facts import Grounds
from mbstab.analysis.verdict.neutral import Structure
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, NumericalError, UsageError
from mbstab.model import balls
from mbstab.model.balls import decimal, plane, real
from mbstab.model.schema import Model
from mbstab.model.values import evaluate
from mbstab.records import Answer, dataclass

T = TypeVar("T")


@dataclass(frozen=True)
class Outcome:
    """The result of a method and its cost.

    Attributes
    ----------
    method : str
        A name of `METHODS`, or a number of digits in words.
    values : ndarray of complex, shape (r,)
        The eigenvalue found for each true one (1/s); nan where it is lost.
    errors : ndarray, shape (r,)
        Distance from the truth relative to its modulus; nan where it is lost.
    own_errors : ndarray, shape (r,)
        The same distance from the exact eigenvalues of the matrices in double precision; nan also
        where those are not known.
    bounds : ndarray, shape (r,)
        Error bounds claimed by the method, also relative.
    lost, invented : int
        Numbers of missing and of spurious eigenvalues, neutral ones included; infinite ones
        and those of constraint drift do not count.
    zeros, drift : float (1/s)
        Largest distance of a neutral eigenvalue, and of one of constraint drift,
        from its exact value.
    besides : str
        What else it returned, in words.
    verdict : str
    seconds : float
        Time from the reference motion to eigenvalues and vectors; with more digits, of the whole computation.
    memory : int
        Peak of allocated memory (bytes).
    failure : str
        Why there is no result; empty: there is one.
    """

    method: str
    values: Any
    errors: Array
    own_errors: Array
    bounds: Array
    lost: int = 0
    invented: int = 0
    zeros: float = 0.0
    drift: float = 0.0
    besides: str = ""
    verdict: str = ""
    seconds: float = math.nan
    memory: int = 0
    failure: str = ""

    @property
    def error(self) -> float:
        """The largest error; infinite if an eigenvalue is lost or invented."""
        if self.failure or self.lost or self.invented:
            return math.inf
        return float(np.max(self.errors, initial=0.0))

    @property
    def own_error(self) -> float:
        """The largest of the method's own errors; nan if they are not known."""
        return float(np.max(self.own_errors, initial=0.0))

    @property
    def bound(self) -> float:
        """The largest claimed error bound of the eigenvalues that were found."""
        return math.inf if self.failure else float(np.max(self.bounds[~np.isnan(self.bounds)], initial=0.0))

    @property
    def exceeded(self) -> bool:
        """Whether an error is larger than the bound that was claimed for it."""
        return bool(np.any(self.errors > self.bounds))


@dataclass(frozen=True)
class Comparison(Answer):
    """All methods on one model.

    Attributes
    ----------
    truth : PreciseResult
    rounding : ndarray, shape (r,)
        Change by the rounding of parameters and matrices to double precision alone, of each
        eigenvalue and relative to its modulus; nan where it is not known.
    outcomes : tuple of Outcome
    seconds : float
        Time for the reference motion and the linearized equations with their checks.
    tolerance : float or None
    chosen : Outcome or None
        The fastest method that keeps the tolerance.
    """

    truth: PreciseResult
    rounding: Array
    outcomes: tuple[Outcome, ...]
    seconds: float
    tolerance: float | None
    chosen: Outcome | None

    def faster(self) -> list[Outcome]:
        """Return the methods that are faster than the chosen one but do not keep the tolerance."""
        return [
            x
            for x in self.outcomes
            if self.chosen is not None and TOLERANCES.equal_times * x.seconds < self.chosen.seconds
        ]


def compare(
    model: Model,
    digits: int = 50,
    tolerance: float | None = None,
    progress: Callable[[float], object] = lambda done: None,
) -> Comparison:
    """Return accuracy and cost of each method.

    Parameters
    ----------
    model : Model
    digits : int
        Digits of the truth.
    tolerance : float, optional
        Largest error relative to the modulus of an eigenvalue, for the choice of a method.
    progress : callable
        Called with the fraction of the work that is done, from 0 to 1.

    Raises
    ------
    UsageError
        If the tolerance is not positive or asks for more digits than the truth has, or the motion
        is periodic.
    NumericalError
        If no method keeps the tolerance.
    MbstabError
        As `mbstab.analysis.spectrum.precise.precise_eigenvalues`.
    """
    _check(tolerance, digits)
    began = time.perf_counter()
    system = System(evaluate(model))
    if system.scene.period is not None:
        raise UsageError(
            f"{model.name} describes a periodic motion: its multipliers have one method, and no truth to compare with\n"
            "hint: mbstab eig, whose error bounds come from two integrations"
        )
    linear = linearize(system, reference_motion(system, massless=True))
    shared = time.perf_counter() - began
    further = _further(digits, tolerance)
    total = 2.0 + len(METHODS) + 2.0 * len(further)
    truth = precise_eigenvalues(
        model, digits, progress=lambda done: progress(2.0 * done / total), zeros=Exactly(lambda: model)
    )
    ruler = _Ruler(truth, linear)
    outcomes = _in_double(Grounds(linear), ruler, lambda number: progress((2.0 + number) / total))
    for number, n in enumerate(further, 1):
        outcomes.append(_with_digits(model, n, ruler))
        progress((2.0 + len(METHODS) + 2.0 * number) / total)
    chosen = cheapest(outcomes, tolerance, truth.verdict) if tolerance is not None else None
    return Comparison(truth, ruler.rounding, tuple(outcomes), shared, tolerance, chosen)


def _check(tolerance: float | None, digits: int) -> None:
    if tolerance is None:
        return
    if not 0.0 < tolerance < 1.0:
        raise UsageError(f"--tol {tolerance:g}: a relative error above 0 and below 1")
    if tolerance < 10.0 ** (2 - digits):
        raise UsageError(
            f"--tol {tolerance:g}: {digits} digits of the truth judge errors down to 1e-{digits - 2}\n"
            f"hint: --digits {math.ceil(-math.log10(tolerance)) + 2}"
        )


def _further(digits: int, tolerance: float | None) -> list[int]:
    """Return the numbers of digits to measure: fewer than those of the truth, and enough for the tolerance."""
    found = [n for n in TOLERANCES.further_digits if n < digits]
    if tolerance is not None:
        needed = max(math.ceil(-math.log10(tolerance)) + 1, SPECTRUM.digits_least)
        found += [needed] if all(n < needed for n in found) else []
    return found


def cheapest(outcomes: Sequence[Outcome], tolerance: float, verdict: str) -> Outcome:
    """Return the fastest outcome that keeps a tolerance and has the verdict of the truth.

    Raises
    ------
    NumericalError
        If none does.
    """
    good = [x for x in outcomes if x.error <= tolerance and x.verdict == verdict]
    if good:
        least = TOLERANCES.equal_times * min(x.seconds for x in good)
        return next(x for x in good if x.seconds <= least)
    best = min(outcomes, key=lambda x: x.error)
    nearest = f": {best.method} comes closest with {best.error:.1e}" if math.isfinite(best.error) else ""
    raise NumericalError(
        f"no method keeps {tolerance:g}{nearest}\n"
        f"hint: mbstab eig --precision {max(SPECTRUM.digits_least, math.ceil(-math.log10(tolerance)) + 1)}"
    )


# --- errors ---------------------------------------------------------------------------------------------------------


class _Ruler:
    """The true eigenvalues, and those of the matrices in double precision."""

    def __init__(self, truth: PreciseResult, linear: Linearization) -> None:
        self.digits = truth.working_digits
        self.exact = truth.values()
        self.rate = state_space(linear).rate
        with balls.digits(self.digits):
            pairs = _pairs(truth.shifts)
            self.neutral = [plane(0)] * (truth.neutral - len(pairs)) + pairs
        rounded = rounded_eigenvalues(linear, truth.digits)
        self.rounded: list[Any] = [None] * len(self.exact)
        if rounded is not None:
            columns, _ = self._columns(rounded)
            for x, column in zip(rounded, columns, strict=True):
                if 0 <= column < len(self.exact):
                    self.rounded[column] = plane(0) if self.exact[column] == 0 else x  # a zero is compared with zero
        self.rounding = self._relative(self.rounded, self.exact)

    def _columns(self, found: Sequence[Any]) -> tuple[list[int], float]:
        """Return which true eigenvalue each found one is, −1 if none, and the largest error of a neutral one."""
        true = [*self.exact, *self.neutral]
        size = max(len(found), len(true))
        cost = np.zeros((size, size))
        with balls.digits(self.digits):
            moduli = [real(self.rate) if s == 0 else abs(s) for s in true[: len(self.exact)]]
            moduli += [real(self.rate)] * len(self.neutral)
            for i, x in enumerate(found):
                # All that match none cost the same, at any distance.
                cost[i, : len(true)] = [
                    min(float(abs(x - s) / modulus), 2.0 * TOLERANCES.eigenvalue_lost)
                    for s, modulus in zip(true, moduli, strict=True)
                ]
        columns = [
            int(j) if j < len(true) and cost[i, j] <= TOLERANCES.eigenvalue_lost else -1
            for i, j in enumerate(assigned(cost)[: len(found)])
        ]
        off = [cost[i, j] for i, j in enumerate(columns) if j >= len(self.exact)]
        return columns, self.rate * max(off, default=0.0)

    def _relative(self, found: Sequence[Any], goals: Sequence[Any]) -> Array:
        """Return |found − goal| relative to the truth, or to a typical rate if that is 0; nan where one is missing."""
        with balls.digits(self.digits):
            return np.array(
                [
                    math.nan if x is None or goal is None else float(abs(x - goal) / (self.rate if s == 0 else abs(s)))
                    for x, goal, s in zip(found, goals, self.exact, strict=True)
                ]
            )

    def outcome(self, method: str, found: Sequence[Any], bounds: Sequence[Any], rounded: bool, **rest: Any) -> Outcome:
        """Return the outcome of a method from the eigenvalues that it found.

        Parameters
        ----------
        method : str
        found : sequence of complex or ``flint.acb``
            All finite eigenvalues (1/s) but those of drift.
        bounds : sequence of float or ``flint.arb``
            Bounds of their errors (1/s).
        rounded : bool
            Whether the method starts from the matrices in double precision.
        """
        found = list(map(plane, found))
        columns, zeros = self._columns(found)
        values: list[Any] = [None] * len(self.exact)
        claimed = np.full(len(self.exact), math.nan)
        for x, bound, column in zip(found, bounds, columns, strict=True):
            if 0 <= column < len(self.exact):
                values[column] = x
                claimed[column] = float(bound / (self.rate if self.exact[column] == 0 else abs(self.exact[column])))
        errors = self._relative(values, self.exact)
        return Outcome(
            method, np.array([complex(math.nan, math.nan) if x is None else complex(x) for x in values]), errors,
            self._relative(values, self.rounded) if rounded else errors, claimed,
            len(self.exact) + len(self.neutral) - sum(j >= 0 for j in columns), sum(j < 0 for j in columns), zeros,
            **rest,
        )  # fmt: skip

    def failure(self, method: str, text: str) -> Outcome:
        """Return the outcome of a method that failed."""
        nothing = np.full(len(self.exact), math.nan)
        return Outcome(method, nothing + 0j, nothing, nothing, nothing, failure=text)


def _pairs(shifts: Sequence[str]) -> list[Any]:
    """Return ±iω of frequencies."""
    return [plane(0, sign * real(decimal(shift))) for shift in shifts for sign in (1, -1)]


# --- costs ----------------------------------------------------------------------------------------------------------


def _in_double(grounds: Grounds, ruler: _Ruler, progress: Callable[[int], object]) -> list[Outcome]:
    """Return the outcomes of the methods in double precision."""
    outcomes: dict[str, Outcome] = {}
    results = {}
    for number, method in enumerate(METHODS, 1):
        try:
            results[method] = _prepared(partial(judged, grounds, method))
        except (MbstabError, ArithmeticError, np.linalg.LinAlgError) as error:
            outcomes[method] = ruler.failure(method, str(error))
        progress(number)
    runs = {method: _alone(grounds, method) for method in results}
    seconds = _medians(runs)
    for method, result in results.items():
        counts = result.counts
        besides = [
            f"{count} {what}"
            for count, what in ((counts.infinite, "infinite"), (counts.undefined, "0/0"), (counts.extra, "of drift"))
            if count
        ]
        outcomes[method] = ruler.outcome(
            method, [e.value for e in result.eigenvalues], [e.error_bound for e in result.eigenvalues], True,
            drift=counts.extra_error, besides=", ".join(besides), verdict=result.verdict, seconds=seconds[method],
            memory=_peak(runs[method]),
        )  # fmt: skip
    return [outcomes[method] for method in METHODS]


def _alone(grounds: Grounds, method: str) -> Callable[[], object]:
    """Return a method from the reference motion to eigenvalues and vectors, without their judgement, as a function.

    The five techniques evaluate the derivatives themselves, the others use those that are
    already available: the cost of these is added to theirs.
    """
    from mbstab.analysis.linear.acceleration_methods import Technique

    linear, separated = grounds.linear, grounds.separated
    invariance, work = grounds.invariance, grounds.structure.work
    system, motion = linear.system, linear.motion
    default = grounds.enclosures()
    turning = separated.frequencies()
    expected = np.concatenate([default.values, turning, np.zeros(separated.neutral.count - len(turning))])
    function = solver(method)

    def run() -> None:
        if not isinstance(function, Technique):
            system.dynamics(motion.q, motion.u, motion.time)
            system.linearize(motion.q, motion.u, motion.a, motion.nu, motion.time)
        if function is not None:
            function(linear, grounds.gamma, expected)
            return
        subspaces(linear.M, linear.J, linear.n_h, linear.rows, motion.sizes)
        space = state_space(linear)
        left = Structure(linear, space, Deflated.of(linear, space, grounds.gamma), invariance, work).separated().A
        if len(left):
            np.linalg.eig(left)

    return run


def _with_digits(model: Model, digits: int, ruler: _Ruler) -> Outcome:
    """Return the outcome of the computation with more digits, from the decimals it prints."""
    method = f"{digits} digits"

    def run() -> PreciseResult:
        return precise_eigenvalues(model, digits, zeros=Exactly(lambda: model))

    try:
        result = _prepared(run)
    except MbstabError as error:
        return ruler.failure(method, str(error))
    with balls.digits(ruler.digits):
        found = [plane(real(decimal(e.real)), real(decimal(e.imag))) for e in result.eigenvalues]
        found += _pairs(result.shifts)
        found += [plane(0)] * (result.counts.found - len(found))
        half = real(10) ** (1 - digits) / 2
        bounds = [e.error_bound + half * abs(e.value) for e in result.eigenvalues]
        bounds += [math.nan] * (len(found) - len(bounds))
    return ruler.outcome(
        method, found, bounds, False, verdict=result.verdict, seconds=_medians({method: run})[method], memory=_peak(run)
    )


def _medians(runs: Mapping[str, Callable[[], object]]) -> dict[str, float]:
    """Return the median times of runs (s); their order is reversed from round to round."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    names = list(runs)
    for _ in range(TOLERANCES.method_timings):
        for name in names:
            if sum(times[name]) < TOLERANCES.method_time:
                began = time.perf_counter()
                runs[name]()
                times[name].append(time.perf_counter() - began)
        names.reverse()
    return {name: statistics.median(found) for name, found in times.items()}


def _prepared(run: Callable[[], T]) -> T:
    """Return the result of a run whose memory is traced later.

    CPython 3.11 looks up line numbers in long kernels so slowly that tracing would take thirty times as long; after a
    profiler it has them ready.
    """
    return cProfile.Profile().runcall(run)


def _peak(run: Callable[[], object]) -> int:
    """Return the peak memory of a run (bytes)."""
    tracemalloc.start()
    try:
        run()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
