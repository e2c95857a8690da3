"""What ``mbstab response`` answers: transfer functions over frequency or time, zeros, margins, largest gains."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.bounds.tolerances import TOLERANCES as BOUNDS
from mbstab.analysis.response.frequency import FrequencyResponse
from mbstab.analysis.response.margins import LargestGain, Margins, closed_loop, largest_gain, margins
from mbstab.analysis.response.state_space import ControlModel
from mbstab.analysis.response.tolerances import TOLERANCES
from mbstab.analysis.response.transfer import Channel, channels
from mbstab.analysis.response.zeros import TransferZeros, Zeros
from mbstab.analysis.verdict.facts import warnings_of
from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.records import Answer, dataclass


def frequencies(zeros: TransferZeros, start: float | None, stop: float | None, points: int) -> Array:
    """Return angular frequencies (rad/s) in equal ratios; without ends, a decade beyond those of the eigenvalues."""
    sizes: Any = np.abs(zeros.poles)
    # What may be zero has no frequency.
    sizes = sizes[(sizes > zeros.bounds) & (sizes > BOUNDS.slow_eigenvalue * np.max(sizes, initial=0.0))]
    low = start if start is not None else 0.1 * float(np.min(sizes, initial=np.inf)) if len(sizes) else 0.1
    high = stop if stop is not None else 10.0 * float(np.max(sizes)) if len(sizes) else 100.0
    low, high = sorted((low, high))
    if not 0.0 < low < high < np.inf:
        raise UsageError(f"frequencies from {low:g} to {high:g} rad/s: two different positive numbers")
    return np.geomspace(low, high, points)


@dataclass(frozen=True)
class Response(Answer):
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
    errors : tuple of ndarray, shape (points,)
        Error bounds of G(iω); empty over time.
    zeros : tuple of Zeros
    poles : ndarray of complex (1/s)
        The eigenvalues.
    margins : tuple of Margins
    largest : tuple of LargestGain
        Of each channel; empty over time, and for very many states.
    growth : tuple of str
        Of each channel over time: a sentence if its output grows without bound, or may do so; empty: it does not.
    exact : FrequencyResponse or None
        Of all channels at any frequency; None over time.
    warnings : tuple of str
        Of the reference motion.
    """

    kind: str
    channels: tuple[Channel, ...]
    x: Array
    values: tuple[Any, ...]
    errors: tuple[Array, ...]
    zeros: tuple[Zeros, ...]
    poles: Complex
    margins: tuple[Margins, ...] = ()
    largest: tuple[LargestGain, ...] = ()
    growth: tuple[str, ...] = ()
    exact: FrequencyResponse | None = None
    warnings: tuple[str, ...] = ()


def duration_of(
    step: float | None, impulse: float | None, ends: tuple[float | None, float | None] = (None, None)
) -> float | None:
    """Return the duration of a response over time (s), None for one over frequency; refuse what is none.

    Raises
    ------
    UsageError
    """
    if step is not None and impulse is not None:
        raise UsageError("--step and --impulse exclude each other")
    duration = impulse if step is None else step
    if duration is not None and not 0.0 < duration < float("inf"):
        raise UsageError(f"a response over {duration:g} s: give a positive time")
    if duration is not None and any(end is not None for end in ends):
        raise UsageError("--from and --to are frequencies, which --step and --impulse do not have")
    return duration


def answer(
    model: ControlModel,
    sources: tuple[str, ...] = (),
    goals: tuple[str, ...] = (),
    ends: tuple[float | None, float | None] = (None, None),
    points: int = 201,
    duration: float | None = None,
    impulse: bool = False,
) -> Response:
    """Return frequency responses, or with a duration (s) those to a unit step or impulse, with zeros and margins.

    Raises
    ------
    UsageError
        If names are unknown, frequencies out of order, or an output has impulses.
    """
    found = channels(model, sources, goals)
    kind = "frequency" if duration is None else "impulse" if impulse else "step"
    exact, told = FrequencyResponse(model), warnings_of(model.linear)
    all_zeros = TransferZeros(exact)
    zeros = tuple(map(all_zeros.of, found))
    if duration is not None:
        x = np.linspace(0.0, duration, points)
        found = [c.without(*z.removable_growing(all_zeros.poles)) for c, z in zip(found, zeros, strict=True)]
        outputs, growth = tuple(c.step(x, impulse) for c in found), tuple(map(all_zeros.growth, zeros))
        return Response(kind, tuple(found), x, outputs, (), zeros, all_zeros.poles, growth=growth, warnings=told)
    x = frequencies(all_zeros, *ends, points)
    values, errors = exact.over(x)
    at = [exact.number(c) for c in found]
    judged = zip(found, zeros, strict=True) if len(all_zeros.poles) <= TOLERANCES.zero_states else ()
    of = [(z, exact.of(c), closed_loop(z, all_zeros.of(c, 1.0))) for c, z in judged]
    return Response(
        kind, tuple(found), x, tuple(values[k] for k in at), tuple(errors[k] for k in at), zeros, all_zeros.poles,
        tuple(margins(*x) for x in of), tuple(largest_gain(*x[:2]) for x in of), exact=exact, warnings=told,
    )  # fmt: skip
