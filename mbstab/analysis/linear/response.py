"""What ``mbstab response`` answers: transfer functions over frequency or time, zeros, margins, largest gains."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.linear.control import ControlModel
from mbstab.analysis.linear.frequency import FrequencyResponse
from mbstab.analysis.linear.margins import LargestGain, Margins, largest_gain, margins
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.analysis.linear.transfer import Channel, Zeros, channels, simple_eigenvalues
from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.records import dataclass


def frequencies(model: ControlModel, start: float | None, stop: float | None, points: int) -> Array:
    """Return angular frequencies (rad/s) in equal ratios; without ends, a decade beyond those of the eigenvalues."""
    poles, errors = simple_eigenvalues(model.A, float(np.linalg.norm(model.A)))
    sizes: Any = np.abs(poles)
    # What may be zero has no frequency.
    sizes = sizes[(sizes > errors) & (sizes > TOLERANCES.slow_eigenvalue * np.max(sizes, initial=0.0))]
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
    errors : tuple of ndarray, shape (points,)
        Error bounds of G(iω); empty over time.
    zeros : tuple of Zeros
    poles : ndarray of complex (1/s)
        Eigenvalues of A.
    margins : tuple of Margins
    largest : tuple of LargestGain
        Of each channel; empty over time, and for very many states.
    exact : FrequencyResponse or None
        Of all channels at any frequency; None over time.
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
    exact: FrequencyResponse | None = None


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
    x = frequencies(model, *ends, points) if duration is None else np.linspace(0.0, duration, points)
    exact = FrequencyResponse(model) if duration is None else None
    if exact is None:
        values, errors = tuple(c.step(x, impulse) for c in found), ()
    else:
        all_values, all_errors = exact.over(x)
        values = tuple(all_values[exact.number(c)] for c in found)
        errors = tuple(all_errors[exact.number(c)] for c in found)
    poles: Complex = np.linalg.eigvals(model.A.astype(complex))
    judged = found if len(poles) <= TOLERANCES.margin_states else []
    beside = tuple(margins(c, exact.of(c)) for c in judged if exact)
    largest = tuple(map(largest_gain, judged if exact else ()))
    zeros = tuple(c.zeros() for c in found)
    return Response(kind, tuple(found), x, values, errors, zeros, poles, beside, largest, exact)
