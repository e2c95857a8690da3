"""Axes: the parameter of a sweep, ranges, and the numbers beside them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, SymmetricalLogLocator

from mbstab.compiler.system import Array
from mbstab.model.units import parse_unit
from mbstab.records import dataclass
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.drawing import text_width

SQUEEZED = 40.0
"""The axis of real parts is logarithmic if the largest is this many times that of the rightmost eigenvalue."""

SHORT = 0.5
"""At half of the values of a parameter, the rightmost eigenvalue counts as this part of its largest at least."""


DEPTH = 1e-4
"""Part of the largest number below which a logarithmic axis is linear in any case."""

LINEAR = 0.4
"""Part of the threshold of a logarithmic axis below which it is nearly linear."""

BESIDE = 0.25
"""Part of the linear range of a logarithmic axis that is shown beyond zero if nothing lies there."""


MULTIPLES = (range(2, 10), (2, 3, 5), (2, 5), (3,), ())
"""Multiples of powers of ten that have labels on a logarithmic axis: as many as have room."""

TICK_GAP = 4.0
"""Room between the labels of two ticks (points on a page)."""

LONGEST = 50
"""Characters of the longest description of a parameter that stands at an axis."""

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def typeset(unit: str) -> str:
    """Return a unit as it is printed.

    >>> typeset("kg*m^2"), typeset("1/s^2"), typeset("N/(rad*s)")
    ('kg·m²', '1/s²', 'N/(rad·s)')

    Plain numbers have none, such as ratios of quantities of one kind:

    >>> typeset("1"), typeset("rad/rad")
    ('', '')
    """
    if unit == "1" or re.fullmatch(r"(.+)/\1", unit):
        return ""
    unit = re.sub(r"(?:\^|\*\*)\(?(-?\d+)\)?", lambda found: found[1].translate(_RAISED), unit)
    return unit.replace("*", "·")


@dataclass(frozen=True)
class Axis:
    """A parameter as an axis: its name, declared unit, the factor that turns the unit into SI, and what it is.

    It may be logarithmic.

    >>> Axis.read("h (mm)")
    Axis(name='h', unit='mm', factor=0.001, quantity='', logarithmic=False)
    >>> Axis("J", "kg*m^2", 1.0, "inertia; likewise").text
    'inertia J (kg·m²)'
    """

    name: str
    unit: str = ""
    factor: float = 1.0
    quantity: str = ""
    logarithmic: bool = False

    @classmethod
    def read(cls, label: Axis | str) -> Axis:
        """Return the axis of a label such as ``omega (rpm)``."""
        if isinstance(label, Axis):
            return label
        name, _, unit = label.removesuffix(")").partition(" (")
        return cls(name, unit, parse_unit(unit)[0] if unit else 1.0)

    @property
    def text(self) -> str:
        """Quantity, name and unit; a long description is left out, and no dollar begins a formula."""
        said = self.quantity.partition(";")[0].replace("$", r"\$")
        name = f"{said} {self.name}" if said and len(said) <= LONGEST else self.name
        unit = typeset(self.unit)
        return f"{name} ({unit})" if unit else name

    def at(self, value: str) -> str:
        """Return a value of the parameter with its name and unit."""
        return f"{self.name} = {value} {typeset(self.unit)}".rstrip()


def set_parameter_axis(axes: Axes, which: str, label: Axis, x: Array) -> None:
    """Set the axis of a parameter to the range of its values (declared unit), logarithmic if the label says so."""
    (axes.set_xlim if which == "x" else axes.set_ylim)(*parameter_range(x))
    if not label.logarithmic:
        return
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis = axes.xaxis if which == "x" else axes.yaxis
    labelled = _labelled_multiples(axes, which)
    axis.set_major_formatter(FuncFormatter(lambda value, _: _tick_text(value)))
    axis.set_minor_formatter(FuncFormatter(lambda value, _: _tick_text(value) if labelled(value) else ""))


def _labelled_multiples(axes: Axes, which: str) -> Callable[[float], bool]:
    """Return which ticks between powers of ten have room for their labels on a logarithmic axis."""
    box = axes.get_window_extent()
    low, high = sorted(axes.get_xlim() if which == "x" else axes.get_ylim())
    factor = 72.0 / axes.figure.dpi * (box.width if which == "x" else box.height) / math.log(high / low)
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)

    def size(tick: float) -> float:
        plain = re.sub(r"[${}^]", "", _tick_text(tick))
        return text_width(plain, scaled(FONT)) if which == "x" else scaled(FONT)

    for multiples in MULTIPLES:
        ticks = sorted(m * 10.0**k for k in decades for m in (1, *multiples))
        near = pairwise(tick for tick in ticks if low <= tick <= high)
        if all(factor * math.log(b / a) > 0.5 * (size(a) + size(b)) + scaled(TICK_GAP) for a, b in near):
            break
    # Ticks that are no such multiples stand where an axis is shorter than from one to the next.
    hidden = set(range(2, 10)) - set(multiples)
    return lambda value: not any(math.isclose(_mantissa(value)[0], m) for m in hidden)


def _mantissa(value: float) -> tuple[float, int]:
    """Return a positive number as a number from 1 to 10 and a power of ten."""
    power = math.floor(math.log10(value) + 1e-9)
    return value / 10.0**power, power


def is_geometric(x: Array) -> bool:
    """Return whether positive values have equal ratios, and not equal differences."""
    if len(x) < 3 or not np.min(x) > 0.0:
        return False
    steps, ratios = np.diff(x), np.diff(np.log(x))
    even = bool(np.ptp(steps) <= 1e-6 * np.max(np.abs(steps)))
    return not even and bool(np.ptp(ratios) <= 1e-6 * np.max(np.abs(ratios)))


def parameter_range(x: Array) -> tuple[float, float]:
    """Return the range of a parameter's axis."""
    if not len(x):
        return 0.0, 1.0
    lo, hi = float(np.min(x)), float(np.max(x))
    half = 0.5 * (abs(lo) or 1.0)
    return (lo, hi) if hi > lo else (lo - half, lo + half)


def axis_range(values: Array, size: float) -> tuple[float, float]:
    """Return the range of an axis; rounding errors are not magnified to fill it."""
    finite = values[np.isfinite(values)]
    lo, hi = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if hi - lo < 1e-6 * size:
        return lo - 0.1 * size, hi + 0.1 * size
    return lo - 0.06 * (hi - lo), hi + 0.06 * (hi - lo)


def upward_range(values: Array, size: float) -> tuple[float, float]:
    """Return the range of an axis of nonnegative values."""
    lo, hi = axis_range(values, size)
    top = hi if hi > 1e-6 * size else 0.1 * size
    # From zero on, a curve that hardly changes is not to lie on the frame.
    return (0.0, max(top, 1.06 * float(np.nanmax(values)))) if lo > 0.0 else (-0.03 * top, top)


def set_real_scale(axes: Axes, which: str, real: Array, largest: float) -> None:
    """Set the axis of the real parts: logarithmic far from zero if those near zero would be compressed."""
    known = real[~np.isnan(real).any(axis=1)] if real.shape[1] else real[:0]
    size = float(np.max(np.abs(known), initial=0.0))
    rightmost = np.abs(np.max(known, axis=1)) if known.size else np.zeros(1)
    # A short stretch of large values does not decide.
    near = max(float(np.median(rightmost)), SHORT * float(np.max(rightmost)))
    lo, hi = axis_range(real, largest)
    beyond = 0.08 if which == "x" else 0.03  # zero is shown, and something of both sides
    lo, hi = min(lo, -beyond * (hi - lo)), max(hi, beyond * (hi - lo))
    limit = axes.set_ylim if which == "y" else axes.set_xlim
    if 0.0 < SQUEEZED * near < size and near > 1e-8 * largest:
        lo, hi = float(np.min(known)), float(np.max(known))
        set_logarithmic(axes, which, 10.0 ** math.ceil(math.log10(near)), lo, hi)
    else:
        limit(lo, hi)


def set_logarithmic(axes: Axes, which: str, threshold: float, lo: float, hi: float) -> None:
    """Make an axis logarithmic beyond a threshold, and say so in its label; it shows the range from lo to hi.

    Its scale is smooth: a curve has no corner where it passes the threshold.
    """
    axis = axes.yaxis if which == "y" else axes.xaxis
    (axes.set_yscale if which == "y" else axes.set_xscale)("asinh", linear_width=LINEAR * threshold)
    axis.set_major_locator(SymmetricalLogLocator(base=10.0, linthresh=threshold))
    axis.set_minor_locator(SymmetricalLogLocator(base=10.0, linthresh=threshold, subs=range(2, 10)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _tick_text(value)))
    limit = axes.set_ylim if which == "y" else axes.set_xlim
    limit(min(1.4 * lo, -BESIDE * threshold), max(1.4 * hi, BESIDE * threshold))
    axis.set_label_text(f"{axis.get_label_text()}, logarithmic beyond {_tick_text(threshold)}")


def decade(small: float, largest: float) -> float:
    """Return the power of ten below a positive number, but no less than `DEPTH` of the largest one."""
    return float(10.0 ** math.floor(math.log10(max(small, DEPTH * largest))))


def _tick_text(value: float) -> str:
    """Return a number of a logarithmic axis, or zero, as text along it."""
    if value == 0.0 or 1e-3 <= abs(value) < 1e5:
        return with_minus_sign(f"{value:g}")
    mantissa, power = _mantissa(abs(value))
    factor = "" if math.isclose(mantissa, 1.0) else f"{mantissa:g}\N{MIDDLE DOT}"
    return f"${'-' if value < 0.0 else ''}{factor}10^{{{power}}}$"


def number_text(value: float, span: float, digits: int) -> str:
    """Return a number as text; one that is rounding error compared with the range is 0."""
    if abs(value) < 1e-9 * span:
        return "0"
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    if not exponent:
        return with_minus_sign(mantissa)
    power = f"10{str(int(exponent)).translate(_RAISED)}"
    return power if mantissa == "1" else f"{with_minus_sign(mantissa)}·{power}"


def with_minus_sign(number: str) -> str:
    """Return a number with the minus sign that matplotlib writes along axes."""
    return number.replace("-", "\N{MINUS SIGN}")
