"""Margins of a loop that is closed with an output, and the largest gain of a transfer function.

The output is subtracted from the input, so that the loop has the eigenvalues of 1 + G(s) = 0. All crossings come from
the zeros and poles of G with their errors (`mbstab.analysis.response.factored`), values from the unreduced equations.
"""

from __future__ import annotations

import math

import numpy as np

from mbstab.analysis.response.factored import Exact, Factored, Undecided
from mbstab.analysis.response.tolerances import TOLERANCES
from mbstab.analysis.response.zeros import Zeros, growing
from mbstab.analysis.verdict.wording import show
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
    error : float (degrees)
        Estimate of the error of the phase margin.
    """

    frequency: float
    phase: float
    delay: float
    error: float


@dataclass(frozen=True)
class PhaseCrossing:
    """Where the response is real and negative.

    Attributes
    ----------
    frequency : float (rad/s)
        Infinite: the response tends to a negative number at high frequencies.
    factor : float
        Gain margin: the factor of the gain that brings an eigenvalue to the imaginary axis at this frequency. At
        infinity a real eigenvalue goes from one side to the other.
    error : float
        Estimate of its error.
    """

    frequency: float
    factor: float
    error: float


@dataclass(frozen=True)
class Margins:
    """Margins of the loop.

    Attributes
    ----------
    closed : bool or None
        Whether the closed loop is stable; None: not decided, or the loop is ill-posed: the response tends to -1 at high
        frequencies.
    gain : tuple of PhaseCrossing
    phase : tuple of GainCrossing
        By frequency.
    always_real : bool
        The response is real at all frequencies: there are no single phase crossings.
    no_delay : bool
        Any delay in the loop, however small, makes it unstable: the gain stays above 1 at high frequencies.
    doubt : str
        Why the margins are not known; empty if they are.
    """

    closed: bool | None
    gain: tuple[PhaseCrossing, ...]
    phase: tuple[GainCrossing, ...]
    always_real: bool
    no_delay: bool = False
    doubt: str = ""

    @property
    def ill_posed(self) -> bool:
        """Whether the response tends to -1 at high frequencies, as far as rounding tells: nothing closes the loop."""
        return any(np.isinf(x.frequency) and abs(x.factor - 1.0) <= x.error for x in self.gain)


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
        Bound of the relative error of the value.
    reason : str
        Why it is infinite or does not exist.
    """

    value: float
    frequency: float
    tolerance: float
    reason: str


def closed_loop(zeros: Zeros, closing: Zeros) -> bool | None:
    """Return whether the closed loop is stable, given the zeros of G and of 1 + G; None: not decided.

    A hidden eigenvalue that grows does so in any loop. An eigenvalue of which G has a trace that is lost beside 1 is
    hidden from 1 + G only as far as rounding tells. Where 1 + G has fewer zeros than G has zeros or poles, G tends to
    -1, and the loop is ill-posed: the next change of its gain decides (Zhou, Doyle, Essentials of Robust Control, 1998,
    section 5.2).
    """
    if zeros.hidden_growing:
        return False
    if zeros.doubt or closing.doubt or sorted(map(_key, zeros.hidden)) != sorted(map(_key, closing.hidden)):
        return None
    posed = len(closing.values) == max(len(zeros.values), len(zeros.poles))
    # Eigenvalues on the imaginary axis are neither.
    return None if not posed else False if closing.growing else closing.minimum_phase or None


def _key(value: complex) -> tuple[float, float]:
    return value.real, value.imag


def margins(zeros: Zeros, exact: Exact, closed: bool | None) -> Margins:
    """Return the margins of the loop that is closed by subtracting the output from the input.

    Parameters
    ----------
    zeros : Zeros
    exact : callable
        Returns G(iω) and its error bounds at frequencies (rad/s).
    closed : bool or None
        Whether all zeros of 1 + G lie left of the imaginary axis and no hidden eigenvalue right of it; None: not
        decided.
    """
    if zeros.doubt:
        return Margins(closed, (), (), False, doubt=zeros.doubt)
    if zeros.vanishes:
        return Margins(closed, (), (), True)
    try:
        own = Factored(zeros, exact)
        phase = tuple(_gain_crossing(omega, own) for omega in own.crossings(own.gain, "the gain"))
        values, errors = exact(own.samples())
        real = bool(np.all(np.abs(values.imag) <= TOLERANCES.errors_of_real * errors))
        gain = () if real else _phase_crossings(own)
    except Undecided as reason:
        return Margins(closed, (), (), False, doubt=str(reason))
    # Hale, Verduyn Lunel, Introduction to Functional Differential Equations, 1993, chapter 9.
    no_delay = own.fall < 0 or (own.fall == 0 and own.log_c > own.error_c)
    return Margins(closed, gain, phase, real, no_delay)


def _gain_crossing(omega: float, own: Factored) -> GainCrossing:
    values, errors = own.exact(np.array([omega]))
    off = own.off_at(omega, own.gain, own.argument) + float(errors[0]) / float(abs(values[0]))
    _require_known(off, f"the phase margin at {omega:.6g} rad/s")
    angle, error = np.degrees([float(np.angle(-values[0])), off]).tolist()
    angle = angle if abs(angle) > error else 0.0  # an eigenvalue is on the axis without a delay
    return GainCrossing(omega, angle, math.radians(angle % 360.0) / omega, error)


def _phase_crossings(own: Factored) -> tuple[PhaseCrossing, ...]:
    """Return where the response is real and negative, without those at which it may be zero."""
    found = []
    crossings = own.crossings(own.argument, "the phase")
    values, errors = own.exact(np.array(crossings))
    if own.order == 0:
        # The equations have no value at 0 beside an eigenvalue 0 that is hidden.
        size, error = own.static()
        crossings = [0.0, *crossings]
        values, errors = np.append(size, values), np.append(error, errors)
    if own.fall == 0:
        size, error = own.direct()
        crossings = [*crossings, np.inf]
        values, errors = np.append(values, size), np.append(errors, error)
    for omega, value, error in zip(crossings, values.tolist(), errors.tolist(), strict=True):
        inner = 0.0 < omega < np.inf
        # Multiple zeros and eigenvalues are known to a part of their digits, and so is the phase.
        turned = float(own.argument(np.array([omega]), np.zeros(1)).error[0]) if inner else 0.0
        if not abs(value.imag) <= error + (TOLERANCES.crossing_misfit + turned) * abs(value):
            raise Undecided(f"the phase at {omega:.6g} rad/s is not the one of the zeros and eigenvalues")
        # A gain that may be zero has no margin.
        if value.real < -error:
            off = error / -value.real + (own.off_at(omega, own.argument, own.gain) if inner else 0.0)
            _require_known(off, f"the gain margin at {omega:.6g} rad/s")
            found.append(PhaseCrossing(omega, -1.0 / value.real, off / -value.real))
    return tuple(found)


def _require_known(off: float, what: str) -> None:
    if not off <= TOLERANCES.margin_known:
        raise Undecided(f"{what} is beyond the errors")


def largest_gain(zeros: Zeros, exact: Exact) -> LargestGain:
    """Return the H-infinity norm of what the input reaches and the output sees."""
    if zeros.vanishes:
        return LargestGain(0.0, 0.0, 0.0, "")
    if zeros.doubt:
        return LargestGain(np.nan, np.nan, np.nan, f"not decided: {zeros.doubt}")
    poles, errors = zeros.poles, zeros.pole_errors
    if growth := growing(zeros.poles, zeros.pole_errors):
        return LargestGain(np.nan, np.nan, np.nan, growth)
    for k in np.flatnonzero(np.abs(poles.real) <= errors):
        if not zeros.undamped[k]:
            reason = f"whether the eigenvalue {show(poles[k])} is damped is beyond its error, {errors[k]:.1g} 1/s"
            return LargestGain(np.nan, np.nan, np.nan, f"not decided: {reason}")
        at = complex(0.0, poles[k].imag)
        return LargestGain(np.inf, abs(at.imag), 0.0, f"the eigenvalue {show(at)} has no damping")
    if len(zeros.values) > len(poles):
        return LargestGain(np.inf, np.inf, 0.0, "the output follows the rate of the input")
    try:
        value, at_frequency, error = Factored(zeros, exact).largest()
    except Undecided as reason:
        return LargestGain(np.nan, np.nan, np.nan, f"not decided: {reason}")
    return LargestGain(value, at_frequency, max(TOLERANCES.level_step, error), "")
