"""What ``mbstab response`` answers: transfer functions over frequency or time, zeros, margins, largest gains."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.linear.control import ControlModel
from mbstab.analysis.linear.margins import LargestGain, Margins, largest_gain, margins
from mbstab.analysis.linear.tolerances import TOLERANCES
from mbstab.analysis.linear.transfer import Channel, Zeros, channels
from mbstab.compiler.system import Array
from mbstab.errors import UsageError
from mbstab.records import dataclass


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
    margins : tuple of Margins
    largest : tuple of LargestGain
        Of each channel; empty over time, and for very many states.
    """

    kind: str
    channels: tuple[Channel, ...]
    x: Array
    values: tuple[Any, ...]
    zeros: tuple[Zeros, ...]
    poles: Complex
    margins: tuple[Margins, ...] = ()
    largest: tuple[LargestGain, ...] = ()


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
    values = tuple(c.at(x) if duration is None else c.step(x, impulse) for c in found)
    poles: Complex = np.linalg.eigvals(model.A.astype(complex))
    judged = found if duration is None and len(poles) <= TOLERANCES.margin_states else []
    return Response(
        kind, tuple(found), x, values, tuple(c.zeros() for c in found), poles,
        tuple(map(margins, judged)), tuple(map(largest_gain, judged)),
    )  # fmt: skip
