"""Stability of a periodic motion by its Floquet multipliers.

Disturbances grow by the multipliers μ in a period T, like exp(s t) with the exponents
s = log(μ)/T; the motion is stable where all |μ| < 1. Multipliers 1 that come from symmetries
or from a shift in time are separated first, by the staircase of `mbstab.analysis.eigen` on
Φ − 1; the others are known to κ‖ΔΦ‖ (Golub and Van Loan 2013, section 7.2.2).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import numpy as np

from mbstab.analysis.eigen import Counts, EigenResult, Eigenvalue, deflate_neutral, kind_of, show
from mbstab.analysis.floquet import Monodromy, monodromy
from mbstab.analysis.motion import Motion
from mbstab.analysis.symmetry import symmetries
from mbstab.compiler.system import System


def periodic_answer(
    system: System, motion: Motion, period: float, progress: Callable[[float], object] | None = None
) -> EigenResult:
    """Return the Floquet exponents (1/s) and multipliers of a periodic motion, with bounds and a verdict.

    Parameters
    ----------
    period : float (s)
    progress : callable, optional
        Is called with the part of the work that is done, from 0 to 1.

    Raises
    ------
    MbstabError
        As `mbstab.analysis.floquet.monodromy`.
    """
    flow = monodromy(system, motion, period, progress)
    spaces = motion.spaces
    n = len(flow.Phi)
    change = flow.Phi - np.eye(n)
    size = float(np.linalg.norm(change, 2)) if n else 1.0
    deflated = deflate_neutral(change, flow.error / max(size, 1e-300)) if n else None
    found: list[Eigenvalue] = []
    steps: tuple[int, ...] = ()
    undecided = ""
    if deflated is not None:
        found = _judged(flow, deflated.S, max(flow.error, deflated.dropped))
        steps, undecided = deflated.steps, deflated.undecided
    neutral = [Eigenvalue(0j, "neutral", math.nan, math.nan, math.nan, multiplier=1 + 0j)] * sum(steps)
    known = [s.name for s in symmetries(system, motion)] if steps else []
    counts = Counts(
        system.n_q, system.n_h, system.n_n, spaces.C.rank, spaces.W.rank, spaces.n_f, n, sum(steps), 0, 0
    )  # fmt: skip
    found.sort(key=lambda e: (-round(e.value.real, 12), abs(e.value.imag), -e.value.imag))
    verdict, reasons = _verdict(found, counts, known, undecided)
    return EigenResult(
        found + neutral, verdict, reasons, counts, steps, tuple(known), "floquet", motion.warnings, period=period
    )


def _judged(flow: Monodromy, rest: np.ndarray, error: float) -> list[Eigenvalue]:
    """Return the multipliers that are not 1, as exponents with bounds."""
    if not len(rest):
        return []
    values, right = np.linalg.eig(rest)
    values = values.astype(complex)
    try:
        left = np.linalg.inv(right).conj().T
        kappa = np.linalg.norm(left, axis=0) * np.linalg.norm(right, axis=0)
    except np.linalg.LinAlgError:
        kappa = np.full(len(values), math.inf)
    found = []
    for j, value in enumerate(values):
        mu = complex(1.0 + value)
        exponent = cmath.log(mu) / flow.period
        stretch = 1.0 / (abs(mu) * flow.period)
        bound = float(kappa[j]) * error * stretch
        others = np.abs(np.delete(values, j) - value)
        separation = float(np.min(others, initial=math.inf)) * stretch
        kind = kind_of(exponent, bound if math.isfinite(bound) else math.inf, separation)
        found.append(Eigenvalue(exponent, kind, bound, float(kappa[j]), error, multiplier=mu))
    return found


def _verdict(found: list[Eigenvalue], counts: Counts, known: list[str], undecided: str) -> tuple[str, tuple[str, ...]]:
    growing = [e for e in found if e.kind in ("unstable node", "unstable focus")]
    if growing:
        worst = max(growing, key=lambda e: e.value.real)
        assert worst.multiplier is not None
        return "unstable", (
            f"disturbances grow by the factor {abs(worst.multiplier):.6g} in a period "
            f"(multiplier {show(worst.multiplier)}, exponent known to {worst.error_bound:.1e} 1/s)",
        )
    doubts = [undecided] if undecided else []
    # A shift in time is a symmetry as well, with a drift of the period.
    if counts.neutral > 2 * (len(known) + 1):
        doubts.append(f"{counts.neutral} multipliers are 1, more than symmetries and a shift in time explain")
    for e in found:
        if e.kind == "undecided" and e.value.imag >= 0.0 and e.multiplier is not None:
            doubts.append(
                f"the multiplier {show(e.multiplier)} is too close to the unit circle or to another one to be placed "
                f"(exponent known to {e.error_bound:.1e} 1/s)"
            )
    if not counts.found:
        doubts.append("constraints and drives leave no motion free whose stability could be judged")
    if doubts:
        return "undecided", tuple(doubts)
    centers = sum(e.kind == "center" for e in found)
    if centers:
        return "marginally stable", (
            f"{centers} multipliers lie on the unit circle, none outside of it: whether disturbances stay small in "
            "the long run is up to nonlinear terms",
        )
    if counts.neutral:
        rest = ", the others decay" if found else ""
        return "marginally stable", (f"{counts.neutral} of the multipliers are 1{rest}",)
    return "asymptotically stable", ("all multipliers lie inside the unit circle",)
