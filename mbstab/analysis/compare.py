"""Every method on one model: what it costs, and what it keeps of eigenvalues known to many digits.

The truth is the same model in multiprecision arithmetic, its parameters the exact decimals of
the file, so an error is a distance from the truth and not from another method.
"""

from __future__ import annotations

import math
import statistics
import time
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbstab.analysis.eigen import EigenResult, eigenvalues
from mbstab.analysis.linearize import Linearization, linearize
from mbstab.analysis.methods import METHODS
from mbstab.analysis.numerics import assigned
from mbstab.analysis.precise import LEAST_DIGITS, PreciseResult, precise_eigenvalues
from mbstab.analysis.reference import reference_motion
from mbstab.analysis.symmetry import Symmetry, symmetries
from mbstab.compiler.system import Array, System
from mbstab.errors import MbstabError, NumericalError, UsageError
from mbstab.model.schema import Model
from mbstab.model.values import evaluate, parse_overrides

REPEATS, ENOUGH = 15, 0.3
"""A method is timed so many times, or until so many seconds have passed; the median counts."""

FURTHER = (20, 30)
"""Numbers of digits besides those of double precision that are measured as well."""

FAR = 1e6
"""Eigenvalues are paired over any distance, but first with others."""

Settings = Mapping[str, float | str]


@dataclass(frozen=True)
class Outcome:
    """What a method returned, and at what price.

    Attributes
    ----------
    method : str
        A name of `METHODS`, or a number of digits in words.
    values : ndarray of complex, shape (r,)
        For each true eigenvalue what the method found (1/s); nan where it lost it.
    errors : ndarray, shape (r,)
        Distance from the truth relative to its modulus; nan where it is lost.
    bounds : ndarray, shape (r,)
        What the method claimed its error to be at most, relative as well.
    lost, invented : int
        Eigenvalues that are missing and that do not exist, besides neutral and infinite ones.
    zeros : float (1/s)
        How far the worst of the neutral eigenvalues came out from where it belongs.
    besides : str
        What it returned besides, in words.
    verdict : str
    seconds : float
        For the eigenvalues, the linearized equations given; with more digits all of it.
    memory : int
        Bytes at most.
    failure : str
        Why it has no answer.
    """

    method: str
    values: Any
    errors: Array
    bounds: Array
    lost: int = 0
    invented: int = 0
    zeros: float = 0.0
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
    def bound(self) -> float:
        """The largest error that was claimed."""
        return math.inf if self.failure else float(np.max(self.bounds, initial=0.0))


@dataclass(frozen=True)
class Comparison:
    """All methods on one model.

    Attributes
    ----------
    truth : PreciseResult
    outcomes : tuple of Outcome
    seconds : float
        For the reference motion and the linearized equations, which all methods share.
    tolerance : float or None
    chosen : Outcome or None
        The fastest that keeps the tolerance.
    """

    truth: PreciseResult
    outcomes: tuple[Outcome, ...]
    seconds: float
    tolerance: float | None
    chosen: Outcome | None


def compare(
    model: Model,
    settings: Settings | None = None,
    digits: int = 50,
    tolerance: float | None = None,
    progress: Callable[[float], object] = lambda done: None,
) -> Comparison:
    """Return what each method keeps and costs.

    Parameters
    ----------
    model : Model
    settings : mapping, optional
        Parameters as after ``--set``.
    digits : int
        Of the truth.
    tolerance : float, optional
        Largest error relative to the modulus of an eigenvalue, for the choice of a method.
    progress : callable
        Is called with the part of the work that is done, from 0 to 1.

    Raises
    ------
    UsageError
        If the tolerance is not positive or asks for more digits than the truth has, or the motion
        is periodic.
    MbstabError
        As `mbstab.analysis.precise.precise_eigenvalues`.
    """
    settings = dict(settings or {})
    if tolerance is not None and not 10.0 ** (2 - digits) <= tolerance < 1.0:
        raise UsageError(f"--tol {tolerance:g}: a number below 1 and above 1e-{digits - 2}, or more --digits")
    further = [n for n in FURTHER if LEAST_DIGITS <= n < digits]
    total = 2.0 + len(METHODS) + len(further)
    truth = precise_eigenvalues(model, settings, digits, progress=lambda done: progress(2.0 * done / total))
    began = time.perf_counter()
    system = System(evaluate(model, parse_overrides(model, settings)))
    motion = reference_motion(system)
    linear = linearize(system, motion)
    shared = time.perf_counter() - began
    known = symmetries(system, motion)
    outcomes = []
    for number, method in enumerate(METHODS):
        outcomes.append(_measured(linear, method, known, truth))
        progress((3.0 + number) / total)
    for number, n in enumerate(further):
        outcomes.append(_with_digits(model, settings, n, truth))
        progress((3.0 + len(METHODS) + number) / total)
    chosen = _chosen(outcomes, tolerance) if tolerance is not None else None
    return Comparison(truth, tuple(outcomes), shared, tolerance, chosen)


def _measured(linear: Linearization, method: str, known: list[Symmetry], truth: PreciseResult) -> Outcome:
    """Return what one method gives in double precision."""

    def run() -> EigenResult:
        return eigenvalues(linear, method, lambda: known)

    try:
        result = run()  # imports what it needs
        seconds = _median(run)
        memory = _peak(run)
    except MbstabError as error:
        nothing = np.full(len(truth.eigenvalues), math.nan)
        return Outcome(method, nothing + 0j, nothing, nothing, failure=str(error))
    found = [e for e in result.eigenvalues if e.kind != "neutral"]
    values, errors, bounds = _paired([e.value for e in found], [e.error_bound for e in found], truth)
    counts = result.counts
    besides = [
        f"{count} {what}"
        for count, what in ((counts.infinite, "infinite"), (counts.undefined, "0/0"), (counts.extra, "of drift"))
        if count
    ]
    neutral = [e.value for e in result.eigenvalues if e.kind == "neutral"]
    zeros = max([0.0, *(min(abs(abs(s) - at) for at in (0.0, *result.shifts)) for s in neutral)])
    return Outcome(
        method, values, errors, bounds, int(np.sum(np.isnan(errors))), max(len(found) - len(truth.eigenvalues), 0),
        max(zeros, counts.extra_error), ", ".join(besides), result.verdict, seconds, memory,
    )  # fmt: skip


def _with_digits(model: Model, settings: Settings, digits: int, truth: PreciseResult) -> Outcome:
    """Return what the same gives with more digits."""
    began = time.perf_counter()
    result = precise_eigenvalues(model, settings, digits)
    seconds = time.perf_counter() - began
    found = [e.value for e in result.eigenvalues]
    values, errors, bounds = _paired(found, [e.error_bound for e in result.eigenvalues], truth)
    return Outcome(
        f"{digits} digits", values, errors, bounds, int(np.sum(np.isnan(errors))),
        max(len(found) - len(truth.eigenvalues), 0), 0.0, "", result.verdict, seconds,
        _peak(lambda: precise_eigenvalues(model, settings, digits)),
    )  # fmt: skip


def _paired(found: list[Any], bounds: list[Any], truth: PreciseResult) -> tuple[Any, Array, Array]:
    """Return for each true eigenvalue the one that was found, its error and its bound, both relative."""
    from mpmath import mp

    exact = truth.values()
    n, k = len(exact), len(found)
    values = np.full(n, complex(math.nan, math.nan))
    errors, claimed = np.full(n, math.nan), np.full(n, math.nan)
    if not n or not k:
        return values, errors, claimed
    with mp.workdps(truth.working_digits):
        distance = [[abs(mp.mpmathify(x) - s) for x in found] for s in exact]
        size = max(n, k)
        cost = np.full((size, size), FAR * max(float(max(map(max, distance))), 1e-300))
        cost[:n, :k] = [[float(x) for x in row] for row in distance]
        for i, j in enumerate(assigned(cost)[:n]):
            if j < k:
                modulus = abs(exact[i])
                values[i] = complex(found[j])
                errors[i], claimed[i] = float(distance[i][j] / modulus), float(bounds[j] / modulus)
    return values, errors, claimed


def _median(run: Callable[[], object]) -> float:
    """Return the median time of some runs (s)."""
    times: list[float] = []
    while len(times) < REPEATS and sum(times) < ENOUGH:
        began = time.perf_counter()
        run()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def _peak(run: Callable[[], object]) -> int:
    """Return how many bytes a run has allocated at most."""
    tracemalloc.start()
    try:
        run()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _chosen(outcomes: list[Outcome], tolerance: float) -> Outcome:
    """Return the fastest outcome that keeps a tolerance.

    Raises
    ------
    NumericalError
        If none does.
    """
    good = [x for x in outcomes if x.error <= tolerance]
    if not good:
        best = min(outcomes, key=lambda x: x.error)
        raise NumericalError(
            f"no method keeps {tolerance:g}: {best.method} comes closest with {best.error:.1e}\n"
            f"hint: mbstab eig --precision {max(LEAST_DIGITS, math.ceil(-math.log10(tolerance)))}"
        )
    return min(good, key=lambda x: x.seconds)
