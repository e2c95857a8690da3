"""Results as pictures: stability maps, root loci, Campbell diagrams, stability charts.

Everything reads in grey too: what a curve means is in its line style and width, regions
differ in lightness, points in their marker. Results are in SI, pictures in declared units.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, SymmetricalLogLocator

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.linear.methods import METHODS
from mbstab.analysis.sweep.sweep import Critical, Sweep
from mbstab.compiler.system import Array
from mbstab.model.units import parse_unit
from mbstab.report.files import whole_file

if TYPE_CHECKING:
    from mbstab.analysis.compare.integrators import Integrations
    from mbstab.analysis.compare.methods import Comparison, Outcome

Mask = npt.NDArray[np.bool_]

FORMATS = ("png", "svg", "pdf")
"""What `save` writes, by suffix."""

INK = ("#000000", "#b03a2e", "#4f94d4")
"""Colours of branches, in turn; apart in grey as well (0, 0.35, 0.54)."""

BEYOND_INK = "0.62"
"""Of the paths to which folds lead."""

UNSTABLE_SHADE = "0.9"
CRITICAL_STYLE = (0, (7, 2, 1.5, 2))
REGIONS = ("1.0", "0.82", "0.64", "0.46", "0.28")
"""Grey of a region by number of unstable eigenvalues; the last is for that number and more."""

TINY = 1e-10
"""Imaginary parts below this part of the largest eigenvalue are drawn as zero."""

THIN, THICK = 1.5, 3.2
"""Width (points) of curves of stable and unstable eigenvalues."""

FONT = 9.0
BINS = 1500
"""Columns a curve is drawn in: more than a page can show."""

ROWS = 5
"""Rows of labels of critical values above a picture; what does not fit goes without."""

LABELS = 60
"""Points that are labelled at most."""

EXACT = 1e-17
"""Smaller errors are chance in double precision; they are drawn here, those of n digits at a tenth of the last one."""

SQUEEZED = 40.0
"""If real parts reach that many times farther than those next to the imaginary axis, their axis is logarithmic."""

WIDTH, LEFT, RIGHT = 7.2, 0.85, 0.25
"""Of a picture and of its margins (inches)."""


@dataclass(frozen=True)
class Axis:
    """A parameter as an axis: its name, declared unit, and the factor that turns the unit into SI.

    >>> Axis.read("h (mm)")
    Axis(name='h', unit='mm', factor=0.001)
    """

    name: str
    unit: str = ""
    factor: float = 1.0

    @classmethod
    def read(cls, label: Axis | str) -> Axis:
        """Return the axis that a label such as ``omega (rpm)`` stands for."""
        if isinstance(label, Axis):
            return label
        name, _, unit = label.removesuffix(")").partition(" (")
        return cls(name, unit, parse_unit(unit)[0] if unit else 1.0)

    @property
    def text(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit not in ("", "1") else self.name

    @property
    def turns(self) -> bool:
        """Whether the parameter is an angular velocity by its unit, such as rad/s, deg/s or rpm."""
        if self.unit == "rpm":
            return True
        return re.fullmatch(r"\s*(rad|deg)\s*/\s*(s|ms|min|h)\s*", self.unit) is not None


# --- pictures -------------------------------------------------------------------------------------------------------


def stability_map(result: Sweep, label: Axis | str, title: str) -> Figure:
    """Return real parts (solid) and imaginary parts (dashed) of all branches over the parameter.

    Of conjugate pairs the lower panel has the positive imaginary part. Critical values are
    vertical lines, unstable ranges are shaded, eigenvalues to the right of the axis are thick.
    """
    label = Axis.read(label)
    with _style():
        picture = _Picture(result, label)
        figure, (upper, lower) = picture.over_parameter(title, ("real part (1/s)", "imaginary part (rad/s)"))
        upper.axhline(0.0, color="0.0", linewidth=0.8)
        for other in picture.others:
            for axes, part, dashed in ((upper, other.real, False), (lower, other.upper_half(), True)):
                for j in range(part.shape[1]):
                    _curve(axes, other.x, part[:, j], BEYOND_INK, other.growing[:, j], dashed)
        above = picture.upper_half()
        for axes, part, dashed in ((upper, picture.real, False), (lower, above, True)):
            for j in range(part.shape[1]):
                _curve(axes, picture.x, part[:, j], picture.ink[j], picture.growing[:, j], dashed)
        # Once for all real eigenvalues: dashes of several on each other would be a solid line.
        level = np.where(np.any(np.abs(picture.imag) <= TINY * picture.size, axis=1), 0.0, np.nan)
        _curve(lower, picture.x, level, INK[0], np.zeros(len(level), dtype=bool), True)
        _real_scale(upper, "y", picture.all(lambda part: part.real), picture.size)
        heights = picture.all(_Picture.upper_half)
        lower.set_ylim(_upward(np.append(heights.ravel(), level), picture.size))
        handles: list[Artist] = [
            Line2D([], [], color="k", linewidth=THIN, label="real part"),
            Line2D([], [], color="k", linewidth=THIN, linestyle="--", label="imaginary part (≥ 0)"),
        ]
        _legend(figure, handles + picture.legend())
        return figure


def root_locus(result: Sweep, label: Axis | str, title: str) -> Figure:
    """Return the paths of the eigenvalues in the complex plane, with their starts, ends and critical points."""
    label = Axis.read(label)
    with _style():
        picture = _Picture(result, label, turned=False)
        figure, (axes,) = _frame(title, heights=(5.0,), above=0.18)
        axes.set_xlabel("real part (1/s)")
        axes.set_ylabel("imaginary part (rad/s)")
        bound = _limits(picture.all(lambda part: part.imag), picture.size)
        axes.set_ylim(bound)
        _real_scale(axes, "x", picture.all(lambda part: part.real), picture.size)
        axes.axvspan(0.0, axes.get_xlim()[1], color=UNSTABLE_SHADE, linewidth=0, zorder=0)
        axes.axvline(0.0, color="0.5", linewidth=1.4, zorder=1.5)
        axes.axhline(0.0, color="0.6", linewidth=0.6, zorder=1)
        for other in picture.others:
            for j in range(other.real.shape[1]):
                _curve(axes, other.real[:, j], other.imag[:, j], BEYOND_INK, other.growing[:, j])
        for j in range(picture.real.shape[1]):
            _curve(axes, picture.real[:, j], picture.imag[:, j], picture.ink[j], picture.growing[:, j])
        for x, text in ((0.01, "stable side"), (0.99, "unstable side")):
            if axes.get_xlim()[0] < 0.0 or x > 0.5:
                side = "left" if x < 0.5 else "right"
                axes.text(x, 1.015, text, transform=axes.transAxes, ha=side, va="bottom", style="italic")
        handles: list[Artist] = []
        known = np.flatnonzero(np.isfinite(picture.real).all(axis=1) & (picture.real.shape[1] > 0))
        ends = [(known[0], "o", 7.5, "none"), (known[-1], "s", 5.0, "k")] if len(known) else []
        for row, marker, size, face in ends:
            axes.plot(
                picture.real[row],
                picture.imag[row],
                marker,
                color="k",
                markersize=size,
                markerfacecolor=face,
                zorder=5.5,
            )
            text = f"{label.name} = {_with_unit(picture.x[row], picture.span, label)}"
            handles.append(
                Line2D(
                    [], [], color="k", linestyle="", marker=marker, markersize=size, markerfacecolor=face, label=text
                )
            )
        labels = _Labels(axes)
        for group in picture.marked[:LABELS]:
            heights = sorted({c.frequency for c in group})
            for height in heights:
                points = [height, -height] if height > 0.0 else [0.0]
                axes.plot([0.0] * len(points), points, "D", color="k", markersize=7, markerfacecolor="w", zorder=5)
                labels.add(0.0, height, f"{label.name} = {picture.show(group[0].value)}")
        labels.draw()
        if picture.marked:
            handles.append(_marker("D", 7.0, "critical value"))
        _legend(figure, handles + picture.legend(over=False))
        return figure


def campbell(result: Sweep, label: Axis | str, title: str, excitations: Sequence[float] = (1.0,)) -> Figure:
    """Return the frequencies of all branches over the parameter.

    Parameters
    ----------
    result : Sweep
    label : Axis or str
        The parameter; as text with its declared unit, such as ``omega (rpm)``.
    title : str
    excitations : sequence of float
        Multiples n of the parameter whose lines n·|parameter|/2π are drawn if it is an
        angular velocity; crossings with branches are marked.
    """
    label = Axis.read(label)
    with _style():
        picture = _Picture(result, label)
        figure, (axes,) = picture.over_parameter(title, ("frequency (Hz)",))
        for other in picture.others:
            for column, growing in zip(other.upper_half().T, other.growing.T, strict=True):
                _curve(axes, other.x, column / (2.0 * math.pi), BEYOND_INK, growing)
        frequency = picture.upper_half() / (2.0 * math.pi)
        for j in range(frequency.shape[1]):
            _curve(axes, picture.x, frequency[:, j], picture.ink[j], picture.growing[:, j])
        axes.set_ylim(_upward(picture.all(_Picture.upper_half) / (2.0 * math.pi), picture.size / (2.0 * math.pi)))
        handles: list[Artist] = [Line2D([], [], color="k", linewidth=THIN, label="frequency of a mode")]
        if label.turns and excitations:
            labels = _Labels(axes)
            crossings = []
            for n in excitations:
                line = abs(n) * np.abs(picture.x) * label.factor / (2.0 * math.pi)
                axes.plot(
                    *_decimated(picture.x, line), color="0.25", linewidth=1.1, linestyle=(0, (1.5, 1.8)), zorder=2
                )
                _name_excitation(labels, picture.x, line, f"{n:g}×")
                crossings += _crossings(picture.x, frequency, line)
            crossings.sort()
            for x, y in crossings[:LABELS]:
                labels.add(x, y, f"{label.name} = {_digits(x, picture.span, 4)}")
            if crossings:
                axes.plot(*zip(*crossings, strict=True), "o", color="k", markersize=6, markerfacecolor="w", zorder=5)
            labels.draw()
            text = f"n× {label.name}"
            handles.append(Line2D([], [], color="0.25", linewidth=1.1, linestyle=(0, (1.5, 1.8)), label=text))
            if crossings:
                handles.append(_marker("o", 6.0, "crossing"))
        _legend(figure, handles + picture.legend(frequency > 0.0))
        return figure


def chart(
    x: Array,
    y: Array,
    unstable: npt.NDArray[np.integer[Any]],
    boundaries: Sequence[Array],
    labels: tuple[Axis | str, Axis | str],
    title: str,
    missing: str = "no answer",
) -> Figure:
    """Return a stability chart of two parameters.

    Parameters
    ----------
    x, y : ndarray
        Values of the parameters (SI), ascending or descending.
    unstable : ndarray of int, shape (len(y), len(x))
        Number of unstable eigenvalues; −1 where the verdict is open, or there is no answer.
    boundaries : sequence of ndarray, shape (k, 2)
        Points of curves (SI); a row of nan breaks a curve.
    labels : tuple of Axis or str
    title : str
    missing : str
        What the legend says of points without a number.
    """
    across, up = (Axis.read(label) for label in labels)
    with _style():
        figure, (axes,) = _frame(title, heights=(4.8,))
        x, y = x / across.factor, y / up.factor
        last = len(REGIONS) - 1
        shown = np.ma.masked_less(np.minimum(unstable, last), 0)
        norm = BoundaryNorm(np.arange(-0.5, last + 1), last + 1)
        cells = axes.pcolormesh(_edges(x), _edges(y), shown, cmap=ListedColormap(REGIONS), norm=norm, rasterized=True)
        cells.set_zorder(0)
        _hatch(axes, _edges(x), _edges(y), unstable < 0)
        for curve in boundaries:
            points = np.asarray(curve, dtype=float).reshape(-1, 2) / (across.factor, up.factor)
            # Light beside dark: the curve is seen on every grey.
            for width, colour in ((2.8, "w"), (1.4, "k")):
                axes.plot(*_thinned(points[:, 0], points[:, 1]), color=colour, linewidth=width, zorder=2)
        axes.set_xlabel(across.text)
        axes.set_ylabel(up.text)
        axes.set_xlim(*_bounds(x))
        axes.set_ylim(*_bounds(y))
        handles: list[Artist] = []
        for count in sorted({int(k) for k in np.unique(np.minimum(unstable, last)) if k >= 0}):
            text = f"{count} or more unstable" if count == last else f"{count} unstable" if count else "stable"
            handles.append(Patch(facecolor=REGIONS[count], edgecolor="0.3", linewidth=0.6, label=text))
        if np.any(unstable < 0):
            handles.append(_no_answer(missing))
        if len(boundaries):
            handles.append(Line2D([], [], color="k", linewidth=1.4, label="stability boundary"))
        _legend(figure, handles)
        return figure


def work_precision(result: Comparison, title: str) -> Figure:
    """Return error against time, one numbered point for each method or number of digits, with the bound it claimed."""
    with _style():
        figure, (axes,) = _frame(title, heights=(4.4,))
        axes.set_xscale("log")
        axes.set_yscale("log")
        points: dict[int, tuple[float, float]] = {}
        smaller = False
        for n, x in enumerate(result.outcomes, 1):
            if not math.isfinite(x.error):
                continue
            floor = EXACT if x.method in METHODS else max(10.0 ** -(1 + int(x.method.split()[0])), 1e-300)
            time, error, below = 1e3 * x.seconds, max(x.error, floor), x.error < floor
            points[n], smaller = (time, error), smaller or below
            if math.isfinite(x.bound) and x.bound > error:
                axes.plot([time, time], [error, x.bound], color="0.6", linewidth=1.0, zorder=2)
                axes.plot(time, x.bound, "_", color="0.6", markersize=8, zorder=2)
            face = "k" if x is result.chosen else "w"
            axes.plot(time, error, "v" if below else "o", color="k", markersize=6, markerfacecolor=face, zorder=4)
        handles: list[Artist] = [
            _marker("o", 6.0, "largest error"),
            Line2D([], [], color="0.6", label="up to the claimed bound"),
        ]
        if smaller:
            handles.append(_marker("v", 6.0, "smaller than drawn"))
        if result.chosen is not None:
            handles.append(Line2D([], [], color="k", linestyle="", marker="o", markersize=6, label="chosen"))
        if result.tolerance is not None:
            axes.axhline(result.tolerance, color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, zorder=1)
            handles.append(Line2D([], [], color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, label="tolerance"))
        rounding = float(np.max(result.rounding, initial=0.0))
        if rounding > EXACT:
            axes.axhline(rounding, color="0.4", linewidth=1.0, linestyle=":", zorder=1)
            handles.append(Line2D([], [], color="0.4", linewidth=1.0, linestyle=":", label="rounding of the data"))
        _decades(axes, list(points.values()), len(result.outcomes))
        labels = _Labels(axes)
        for n, (time, error) in points.items():
            labels.add(time, error, str(n))
        labels.draw()
        axes.set_xlabel("time (ms); of digits from the file, of the others from the reference motion")
        axes.set_ylabel("largest relative error of an eigenvalue")
        lines = [f"{n}  {x.method}{_missing(x)}" for n, x in enumerate(result.outcomes, 1)]
        # Methods in double precision are fast and inexact, digits are neither: this corner is free.
        axes.text(
            0.02, 0.03, "\n".join(lines), transform=axes.transAxes, ha="left", va="bottom", fontsize=FONT, zorder=6
        )
        _legend(figure, handles)
        return figure


def integrator_precision(result: Integrations, title: str) -> Figure:
    """Return global error against time, one line for each integrator, a point for each tolerance."""
    looks = (("o", "-"), ("s", "-"), ("^", "--"), ("v", "--"), ("D", ":"), ("P", ":"))
    with _style():
        figure, (axes,) = _frame(title, heights=(4.4,))
        axes.set_xscale("log")
        axes.set_yscale("log")
        handles: list[Artist] = []
        names = list(dict.fromkeys(x.name for x in result.runs))
        for name, (marker, style) in zip(names, looks, strict=False):
            points = [(1e3 * x.seconds, max(x.error, EXACT)) for x in result.runs if x.name == name and not x.failure]
            look: dict[str, Any] = {"color": "k", "linewidth": 1.0, "linestyle": style, "marker": marker}
            look |= {"markersize": 6, "markerfacecolor": "w"}
            if points:
                axes.plot(*zip(*points, strict=True), **look)
                handles.append(Line2D([], [], label=name, **look))
        if result.chosen is not None:
            chosen: dict[str, Any] = {"color": "k", "linestyle": "", "marker": "o", "markersize": 3}
            axes.plot(1e3 * result.chosen.seconds, max(result.chosen.error, EXACT), **chosen, zorder=5)
            handles.append(Line2D([], [], **chosen, label="chosen"))
        if result.tolerance is not None:
            axes.axhline(result.tolerance, color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, zorder=1)
            handles.append(Line2D([], [], color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, label="tolerance"))
        if result.known > EXACT:
            axes.axhline(result.known, color="0.4", linewidth=1.0, linestyle=":", zorder=1)
            handles.append(Line2D([], [], color="0.4", linewidth=1.0, linestyle=":", label="reference (estimate)"))
        axes.set_xlabel("time of a run (ms)")
        axes.set_ylabel(f"global error until t = {result.end:g} s")
        _legend(figure, handles)
        return figure


def _missing(x: Outcome) -> str:
    if x.failure:
        return ": no answer"
    parts = [f"{count} {what}" for count, what in ((x.lost, "lost"), (x.invented, "invented")) if count]
    return f": {', '.join(parts)}" if parts else ""


def _decades(axes: Axes, points: Sequence[tuple[float, float]], entries: int) -> None:
    """Set logarithmic limits with room for labels beside the points, and for a list in the lower left corner."""
    if not points:
        return
    times = [time for time, _ in points]
    lower, upper = float(axes.dataLim.y0), float(axes.dataLim.y1)
    span = max(math.log10(max(times) / min(times)), 1.0)
    axes.set_xlim(min(times) * 10.0 ** (-0.12 * span), max(times) * 10.0 ** (0.12 * span))
    lowest_there = min(error for time, error in points if time < min(times) * 10.0 ** (0.5 * span))
    part = 0.045 * entries + 0.08  # of the height, for the list
    top = math.log10(upper) + 1.0
    bottom = min(math.log10(lower) - 1.0, (math.log10(lowest_there) - part * top) / (1.0 - part))
    axes.set_ylim(10.0 ** max(bottom, -306.0), 10.0**top)


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a picture; the file appears whole or not at all, and is the same for the same picture.

    Parameters
    ----------
    figure : Figure
    path : path
        The suffix says how: ``.png`` (150 dpi), ``.svg`` or ``.pdf``.

    Raises
    ------
    ValueError
        If the suffix is another one.
    OSError
        If the file cannot be written.
    """
    goal = Path(path).resolve()
    kind = goal.suffix[1:].lower()
    if kind not in FORMATS:
        raise ValueError(f"{path}: pictures end with {', '.join('.' + name for name in FORMATS)}")
    # None takes the entry out: nothing of the day or of the library is in the file.
    metadata: dict[str, dict[str, None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    }
    with whole_file(goal) as stream, _style(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph ")  # a title in a script the font lacks
        figure.savefig(stream, format=kind, dpi=150 if kind == "png" else 300, metadata=metadata[kind])


# --- what sweeps have in common -------------------------------------------------------------------------------------


class _Picture:
    """A sweep in declared units, ready to be drawn.

    Attributes
    ----------
    points, unstable : ndarray, shape (points,)
        Parameter, ascending, and number of unstable eigenvalues.
    x : ndarray, shape (n,)
        Parameter with more points where eigenvalues meet or pass the axis; ascending unless `turned` is false.
    real, imag : ndarray, shape (n, r)
    growing : ndarray of bool, shape (n, r)
        Which eigenvalues are the unstable ones.
    size : float
        Largest eigenvalue.
    span : float
        Range of the parameter.
    ink : list of str
        A colour for each branch; conjugate branches share theirs.
    critical : list of list of Critical
        Those that are the same in six digits are together; values in the declared unit.
    others : list of _Picture
        The paths to which folds lead.
    """

    def __init__(self, result: Sweep, label: Axis, turned: bool = True) -> None:
        self.label = label
        x, branches, self.unstable = np.asarray(result.values, dtype=float), result.branches, result.unstable
        # A nan with an imaginary part of 0 would be drawn as 0.
        branches = np.where(np.isnan(branches), complex(math.nan, math.nan), branches)
        down = len(x) > 1 and x[0] > x[-1]
        if down:
            x, branches, self.unstable = x[::-1], branches[::-1], self.unstable[::-1]
        self.points = x / label.factor
        self.span = float(np.ptp(self.points)) if len(x) > 1 else abs(float(self.points[0])) if len(x) else 1.0
        finite = np.abs(branches[~np.isnan(branches)])
        self.size = float(np.max(finite, initial=0.0)) or 1.0
        self.ink = _inks(branches)
        x, branches, self.growing = _refined(x, branches, _growing(branches, self.unstable), result)
        if down and not turned:
            x, branches, self.growing = x[::-1], branches[::-1], self.growing[::-1]
        self.x, self.real, self.imag = x / label.factor, branches.real, branches.imag
        self.critical: list[list[Critical]] = []
        for c in sorted(result.critical, key=lambda c: c.value):
            item = replace(c, value=c.value / label.factor)
            if self.critical and self.show(self.critical[-1][0].value) == self.show(item.value):
                self.critical[-1].append(item)
            else:
                self.critical.append([item])
        self.unlabelled = 0
        self.others = [_Picture(path, label, turned) for path in result.beyond]
        self.size = max([self.size, *(other.size for other in self.others)])
        unanswered = np.zeros(len(result.values), dtype=bool)
        unanswered[result.unanswered] = True
        # An undecided point on a critical value leaves nothing open beside it.
        places = np.array([c.value for c in result.critical])
        width = float(np.max(np.abs(result.values), initial=0.0))
        at = np.any(np.abs(result.values[:, None] - places) <= 1e-9 * width, axis=1)
        undecided = (result.unstable < 0) & ~np.any(np.isnan(result.branches), axis=1) & ~at
        self.gap = gap(bool(unanswered.any()), bool(undecided.any()))
        unanswered |= undecided
        self.unanswered = unanswered[::-1] if down else unanswered
        self.marked = sorted(
            [*self.critical, *(group for other in self.others for group in other.critical)],
            key=lambda group: group[0].value,
        )

    def all(self, part: Callable[[_Picture], Array]) -> Array:
        """Return something of this path and of the others, one after the other."""
        found = [part(picture) for picture in (self, *self.others)]
        width = max(x.shape[1] for x in found)
        return np.concatenate([np.pad(x, ((0, 0), (0, width - x.shape[1])), constant_values=np.nan) for x in found])

    def show(self, value: float) -> str:
        """Return a value of the parameter with six digits."""
        return _digits(value, self.span, 6)

    def upper_half(self) -> Array:
        """Return the positive imaginary parts, and 0 next to them, where a frequency starts or ends; nan elsewhere."""
        tiny = TINY * self.size
        above, zero = self.imag > tiny, np.abs(self.imag) <= tiny
        beside = np.zeros_like(above)
        beside[1:] |= above[:-1]
        beside[:-1] |= above[1:]
        return np.where(above | (zero & beside), self.imag, np.nan)

    def over_parameter(self, title: str, names: Sequence[str]) -> tuple[Figure, list[Axes]]:
        """Return panels over the parameter, with critical values and unstable ranges."""
        lo, hi = _bounds(self.points)
        rows, places = self._places(lo, hi)
        heights = (2.7, 2.3) if len(names) == 2 else (4.4,)
        figure, panels = _frame(title, heights, above=0.17 * rows)
        for axes, name in zip(panels, names, strict=True):
            axes.set_ylabel(name)
            axes.set_xlim(lo, hi)
            for a, b, state in self._ranges():
                if state < 0:
                    axes.axvspan(a, b, facecolor="none", edgecolor="0.6", hatch="////", linewidth=0, zorder=0)
                else:
                    axes.axvspan(a, b, color=UNSTABLE_SHADE, linewidth=0, zorder=0)
            for group in self.marked:
                axes.axvline(group[0].value, color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, zorder=1.5)
        panels[-1].set_xlabel(self.label.text)
        for axes in panels[:-1]:
            axes.tick_params(labelbottom=False)
        pointer = {"arrowstyle": "-", "linewidth": 0.5, "color": "0.5"}
        for group, text, at, row in places:
            panels[0].annotate(
                text, (group[0].value, 1.0), (at, 3.0 + 12.2 * row), xycoords=panels[0].get_xaxis_transform(),
                textcoords=_beside(figure, panels[0]), ha="center", va="bottom", fontsize=FONT - 0.5,
                annotation_clip=False, arrowprops={**pointer, "shrinkA": 0, "shrinkB": 0} if row else None,
            )  # fmt: skip
        if not self.real.shape[1] or np.all(np.isnan(self.real)):
            panels[0].text(0.5, 0.5, "no eigenvalues to show", transform=panels[0].transAxes, ha="center")
        return figure, panels

    def _places(self, lo: float, hi: float) -> tuple[int, list[tuple[list[Critical], str, float, int]]]:
        """Return the number of rows of labels, and for critical values text, place and row."""
        wide = (WIDTH - LEFT - RIGHT) * 72.0
        ends = [-math.inf] * ROWS
        places = []
        for group in self.marked:
            kinds = list(dict.fromkeys(c.kind for c in group))
            text = f"{self.show(group[0].value)} {', '.join(kinds)}" + (f" ({len(group)}×)" if len(group) > 1 else "")
            half = 0.5 * _text_width(text, FONT - 0.5)
            at = min(max((group[0].value - lo) / (hi - lo) * wide, half - 30.0), wide - half + 10.0)
            row = next((k for k in range(ROWS) if ends[k] + 8.0 < at - half), None)
            if row is None:
                self.unlabelled += 1
                continue
            ends[row] = at + half
            places.append((group, text, at / wide, row))
        return 1 + max((row for *_, row in places), default=-1), places

    def _ranges(self) -> Iterator[tuple[float, float, int]]:
        """Yield ranges of the parameter that are unstable (1) or have no answer (−1), as long as they are."""
        if len(self.points) < 2:
            return
        # Values that another path answers are not shaded.
        x, sign = self.points, np.where((self.unstable < 0) & ~self.unanswered, 0, np.sign(self.unstable))
        state = np.where((sign[:-1] < 0) | (sign[1:] < 0), -1, sign[:-1])
        changes = (state >= 0) & (sign[:-1] != sign[1:])
        cuts: dict[int, list[Critical]] = {}
        for c in (c for group in self.critical for c in group):
            k = int(np.searchsorted(x, c.value)) - 1
            if 0 <= k < len(state) and x[k] < c.value < x[k + 1] and state[k] >= 0:
                cuts.setdefault(k, []).append(c)
                changes[k] = True
        key = np.where(changes, 2 + np.arange(len(state)), state)
        starts = np.flatnonzero(np.diff(key, prepend=-2))
        found: list[tuple[float, float, int]] = []
        for k, end in pairwise([*starts.tolist(), len(state)]):
            inside = cuts.get(k, [])
            edges, states = [float(x[k]), float(x[end])], [int(state[k])]
            if inside:
                edges[1:1] = [c.value for c in inside]
                states = [int(c.unstable[0] > 0) for c in inside] + [int(inside[-1].unstable[1] > 0)]
            elif changes[k]:
                edges[1:1] = [0.5 * (edges[0] + edges[1])]
                states.append(int(sign[k + 1]))
            for (a, b), value in zip(pairwise(edges), states, strict=True):
                if found and found[-1][2] == value:
                    found[-1] = (found[-1][0], b, value)
                elif b - a > 1e-9 * self.span:
                    found.append((a, b, value))
        yield from (piece for piece in found if piece[2])

    def legend(self, seen: Mask | None = None, over: bool = True) -> list[Artist]:
        """Return what the legends of all pictures of sweeps have in common."""
        handles: list[Artist] = []
        growing = self.growing if seen is None else self.growing & seen
        if np.any(growing) or any(np.any(other.growing) for other in self.others):
            handles.append(Line2D([], [], color="k", linewidth=THICK, label="unstable eigenvalue"))
        if over and self.marked:
            text = "critical value" + (f" ({self.unlabelled} without label)" if self.unlabelled else "")
            handles.append(Line2D([], [], color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, label=text))
        if self.others:
            handles.append(Line2D([], [], color=BEYOND_INK, linewidth=THIN, label="further paths"))
        if over and np.any(self.unstable > 0):
            handles.append(Patch(facecolor=UNSTABLE_SHADE, edgecolor="0.6", linewidth=0.6, label="unstable range"))
        if over and np.any(self.unanswered):
            handles.append(_no_answer(self.gap))
        return handles


def _growing(branches: Complex, unstable: npt.NDArray[np.intp]) -> Mask:
    """Return which eigenvalues are unstable: as many as were counted, those farthest to the right."""
    rank = np.argsort(np.argsort(-branches.real, axis=1, kind="stable"), axis=1, kind="stable")
    found: Mask = (rank < unstable[:, None]) & (branches.real > 0.0)
    return found


def _refined(x: Array, branches: Complex, growing: Mask, result: Sweep) -> tuple[Array, Complex, Mask]:
    """Return branches with more points where eigenvalues pass the axis or collide: there they move like a root."""
    # How many pairs may collide at a place; a divergence may be the collision of a pair at zero.
    places = [(c.value, {"divergence": 1, "collision": 2}.get(c.kind, 0)) for c in result.critical]
    places += [(at, 1) for at, how in result.meetings if how == "collide"]
    by_interval: dict[int, dict[float, int]] = {}
    for at, number in places:
        k = int(np.searchsorted(x, at)) - 1
        if 0 <= k < len(x) - 1 and x[k] < at < x[k + 1] and not np.any(np.isnan(branches[k : k + 2])):
            near = by_interval.setdefault(k, {})
            # Stability changes and meetings are located by themselves: the same place twice.
            twin = next((other for other in near if abs(other - at) < 1e-9 * (x[k + 1] - x[k])), at)
            near[twin] = max(near.get(twin, 0), number)
    new_x, new_branches, new_growing, where = [], [], [], []
    for k, near in by_interval.items():
        before, after = branches[k], branches[k + 1]
        pairs: dict[float, list[tuple[int, int]]] = {
            at: _meeting_pairs(x, branches, k, at, n) for at, n in near.items()
        }
        fine = [-0.5, -0.15, 0.0, 0.15, 0.5]
        for at in near:
            for step in fine if len(near) == 1 and pairs[at] else [0.0]:
                p = at + step * (at - x[k] if step < 0.0 else x[k + 1] - at)
                row = _between(before, after, (p - x[k]) / (x[k + 1] - x[k]))
                for i, j in pairs[at]:
                    middle = 0.5 * (row[i] + row[j])
                    apart = before[i] - before[j] if step < 0.0 else after[i] - after[j]
                    row[i] = middle + 0.5 * apart * math.sqrt(abs(step))
                    row[j] = middle - 0.5 * apart * math.sqrt(abs(step))
                new_x.append(p)
                new_branches.append(row)
                new_growing.append(
                    growing[k] if step < 0 else growing[k + 1] if step > 0 else growing[k] | growing[k + 1]
                )
                where.append(k + 1)
    if not new_x:
        return x, branches, growing
    x = np.insert(x, where, new_x)
    order = np.argsort(x, kind="stable")
    branches = np.insert(branches, where, new_branches, axis=0)
    return x[order], branches[order], np.insert(growing, where, new_growing, axis=0)[order]


def _between(before: Complex, after: Complex, part: float) -> Complex:
    row: Complex = before + part * (after - before)
    return row


def _meeting_pairs(x: Array, branches: Complex, k: int, at: float, number: int) -> list[tuple[int, int]]:
    """Return the pairs of branches that collide between two points: the square of their difference passes zero."""
    part = (at - x[k]) / (x[k + 1] - x[k])
    found = []
    r = branches.shape[1]
    for i in range(r):
        for j in range(i + 1, r):
            one, other = ((branches[m, i] - branches[m, j]) ** 2 for m in (k, k + 1))
            size = abs(one) + abs(other)
            rest = abs(one + part * (other - one))
            if (one * other.conjugate()).real < 0.0 and rest < 0.1 * size:
                found.append((rest / size, i, j))
    pairs: list[tuple[int, int]] = []
    for _, i, j in sorted(found):
        if len(pairs) < number and not any({i, j} & set(pair) for pair in pairs):
            pairs.append((i, j))
    return pairs


def _inks(branches: Complex) -> list[str]:
    """Return colours of branches: the same for those that are conjugate somewhere."""
    r = branches.shape[1]
    group = list(range(r))
    some = branches[:: max(1, len(branches) // 500)]
    size = np.max(np.abs(some), axis=1, initial=0.0)
    for i in range(r):
        for j in range(i):
            apart = np.abs(some[:, i] - np.conj(some[:, j]))
            if np.any((apart <= 1e-9 * size) & (np.abs(some[:, i].imag) > 1e-6 * size)):
                group = [group[j] if g == group[i] else g for g in group]
    order = list(dict.fromkeys(group))
    return [INK[order.index(g) % len(INK)] for g in group]


def _crossings(x: Array, frequency: Array, line: Array) -> list[tuple[float, float]]:
    """Return where branches cross an excitation line, each place once; not where both are zero."""
    found: list[tuple[float, float]] = []
    top = float(np.nanmax(frequency)) if frequency.size and not np.all(np.isnan(frequency)) else 0.0
    span = float(np.ptp(x)) if len(x) else 0.0
    with np.errstate(invalid="ignore"):
        gap = frequency - line[:, None]
        passed = (gap[:-1] * gap[1:] < 0.0) | ((gap[:-1] == 0.0) & (gap[1:] != 0.0))
    for i, j in zip(*np.nonzero(passed), strict=True):
        part = float(gap[i, j] / (gap[i, j] - gap[i + 1, j]))
        at = (float(x[i] + part * (x[i + 1] - x[i])), float(line[i] + part * (line[i + 1] - line[i])))
        new = all(abs(at[0] - a) > 1e-4 * span or abs(at[1] - b) > 1e-4 * top for a, b in found)
        if at[1] > 1e-6 * top and new:
            found.append(at)
    return found


def _name_excitation(labels: _Labels, x: Array, line: Array, text: str) -> None:
    """Write the name of an excitation line where it leaves the picture on the right, or on the left."""
    inside = np.flatnonzero((line <= labels.axes.get_ylim()[1]) & ((x > 0.0) | (x[-1] <= 0.0)))
    if len(inside):
        k = inside[int(0.95 * (len(inside) - 1))] if x[-1] > 0.0 else inside[len(inside) // 20]
        labels.add(float(x[k]), float(line[k]), text, marked=False)


# --- curves ---------------------------------------------------------------------------------------------------------


def _curve(axes: Axes, x: Array, y: Array, ink: str, thick: Mask, dashed: bool = False) -> None:
    """Draw a branch; nan breaks it, its unstable parts are thick."""
    fewer = _thinned if np.any(np.diff(x[~np.isnan(x)]) < 0.0) else _decimated
    inner = thick.copy()
    inner[1:] &= thick[:-1]
    inner[:-1] &= thick[1:]
    for hidden, width in ((inner, THIN), (~thick, THICK)):
        shown = np.where(hidden, np.nan, y)
        if not np.isfinite(shown).any():
            continue
        # Dashes of the same length whatever the width, which they are multiples of.
        dashes: Any = (0, (5.8 / width, 2.4 / width)) if dashed else "-"
        axes.plot(
            *fewer(x, shown), color=ink, linewidth=width, linestyle=dashes, zorder=3,
            solid_capstyle="butt", dash_capstyle="butt",
        )  # fmt: skip
    finite = np.isfinite(x) & np.isfinite(y)
    beside = np.zeros_like(finite)
    beside[1:] |= finite[:-1]
    beside[:-1] |= finite[1:]
    alone = finite & ~beside
    if alone.any():
        axes.plot(*fewer(x[alone], y[alone]), ".", color=ink, markersize=4, zorder=3)


def _decimated(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the points of a curve over ascending x that a picture can show.

    Of every column the first and the last point stay, the highest and the lowest, and a nan.
    """
    n = len(x)
    if n <= 5 * BINS:
        return x, y
    column = np.minimum(((x - x[0]) * (BINS / (x[-1] - x[0]))).astype(np.intp), BINS - 1)
    starts = np.flatnonzero(np.diff(column, prepend=-1))
    finite = np.isfinite(y)
    position = np.arange(n)
    kept = [
        np.minimum.reduceat(np.where(finite, position, n), starts),
        np.maximum.reduceat(np.where(finite, position, -1), starts),
        np.minimum.reduceat(np.where(finite, n, position), starts),
    ]
    count = np.diff(np.append(starts, n))
    for values in (np.where(finite, y, np.inf), np.where(finite, -y, np.inf)):
        lowest = np.repeat(np.minimum.reduceat(values, starts), count)
        kept.append(np.minimum.reduceat(np.where(finite & (values == lowest), position, n), starts))
    index = np.unique(np.concatenate(kept))
    index = index[(index >= 0) & (index < n)]
    return x[index], y[index]


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the points of a curve in the plane without those that a picture cannot tell from the one before."""
    if len(x) <= 5 * BINS:
        return x, y
    finite = np.isfinite(x) & np.isfinite(y)
    if not finite.any():
        return x[:1], y[:1]
    cells = []
    for values in (x, y):
        low, high = float(np.min(values[finite])), float(np.max(values[finite]))
        cells.append(np.where(finite, (values - low) * (BINS / max(high - low, 1e-300)), np.nan))
    z = cells[0] + 1j * cells[1]
    grid = np.where(finite, np.floor(cells[0]) * 2.0 * BINS + np.floor(cells[1]), -1.0)
    moved = np.diff(grid) != 0.0
    # The last point in a cell stays too: at a turn or before a gap it is the end.
    kept = np.flatnonzero(np.concatenate([[True], moved]) | np.concatenate([moved, [True]]))
    for _ in range(8):
        # Every other point goes if it lies on the way from the one before to the one after.
        before, middle, after = z[kept[:-2:2]], z[kept[1:-1:2]], z[kept[2::2]]
        way = after - before
        part = (middle - before) * np.conj(way)
        length = np.abs(way)
        needless = (np.abs(part.imag) < 0.1 * length) & (part.real > 0.0) & (part.real < length**2)
        kept = np.delete(kept, 1 + 2 * np.flatnonzero(needless))
    return x[kept], y[kept]


def _edges(values: Array) -> Array:
    """Return the edges of cells around values."""
    if len(values) < 2:
        half = 0.5 * (abs(float(values[0])) or 1.0)
        return np.array([values[0] - half, values[0] + half])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def _hatch(axes: Axes, x: Array, y: Array, where: Mask) -> None:
    """Hatch cells; neighbours in a row are one rectangle."""
    rectangles = []
    for k, row in enumerate(where):
        change = np.flatnonzero(np.diff(np.concatenate([[0], row.astype(np.intp), [0]])))
        for a, b in change.reshape(-1, 2):
            rectangles.append([(x[a], y[k]), (x[b], y[k]), (x[b], y[k + 1]), (x[a], y[k + 1])])
    if rectangles:
        axes.add_collection(
            PolyCollection(rectangles, facecolors="w", edgecolors="0.5", hatch="////", linewidths=0.0, zorder=0.5),
            autolim=False,
        )


# --- frames, axes, labels -------------------------------------------------------------------------------------------


@contextmanager
def _style() -> Iterator[None]:
    """Draw with the defaults of matplotlib, whatever the user's matplotlibrc says, and with what pictures here need."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(
            {
                "font.size": FONT,
                "axes.labelsize": FONT + 0.5,
                "axes.formatter.limits": (-4, 5),
                "axes.formatter.useoffset": False,
                "hatch.linewidth": 0.5,
                "pdf.fonttype": 42,
                "svg.fonttype": "path",
                "svg.hashsalt": "mbstab",
            }
        )
        yield


def _frame(title: str, heights: Sequence[float], above: float = 0.0) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels (heights in inches) below each other, room above them, and its title."""
    lines = wrap(title, 80)[:3]
    top = 0.15 + 0.2 * len(lines) + above + 0.1
    gap, bottom = 0.12, 1.05
    total = top + sum(heights) + gap * (len(heights) - 1) + bottom
    figure = Figure(figsize=(WIDTH, total))
    panels, at = [], total - top
    for height in heights:
        at -= height
        panels.append(figure.add_axes((LEFT / WIDTH, at / total, (WIDTH - LEFT - RIGHT) / WIDTH, height / total)))
        at -= gap
    figure.text(0.5, 1.0 - 0.1 / total, "\n".join(lines), ha="center", va="top", fontsize=FONT + 2.0, parse_math=False)
    return figure, panels


def _legend(figure: Figure, handles: Sequence[Artist]) -> None:
    columns = 3 if len(handles) <= 6 else 4
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=columns,
        frameon=False,
        handlelength=3.2,
        columnspacing=1.5,
        borderaxespad=0.3,
    )


def _marker(marker: str, size: float, text: str) -> Line2D:
    return Line2D([], [], color="k", linestyle="", marker=marker, markersize=size, markerfacecolor="w", label=text)


def gap(unanswered: bool, undecided: bool) -> str:
    """Return what the legend says of hatched parts."""
    return " or ".join(["undecided"] * undecided + ["no answer"] * (unanswered or not undecided))


def _no_answer(text: str = "no answer") -> Patch:
    return Patch(facecolor="w", edgecolor="0.6", hatch="//////", linewidth=0.6, label=text)


def _beside(figure: Figure, axes: Axes) -> Any:
    """Return coordinates: across as a part of the axes, up in points from their upper edge."""
    from matplotlib.transforms import Affine2D, blended_transform_factory

    edge = figure.get_figheight() * axes.get_position().y1
    up = Affine2D().scale(1.0 / 72.0).translate(0.0, edge) + figure.dpi_scale_trans
    return blended_transform_factory(axes.transAxes, up)


def _bounds(x: Array) -> tuple[float, float]:
    """Return the range of a parameter's axis."""
    if not len(x):
        return 0.0, 1.0
    lo, hi = float(np.min(x)), float(np.max(x))
    half = 0.5 * (abs(lo) or 1.0)
    return (lo, hi) if hi > lo else (lo - half, lo + half)


def _limits(values: Array, size: float) -> tuple[float, float]:
    """Return the range of an axis; rounding is not blown up to fill it."""
    finite = values[np.isfinite(values)]
    lo, hi = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if hi - lo < 1e-6 * size:
        return lo - 0.1 * size, hi + 0.1 * size
    return lo - 0.06 * (hi - lo), hi + 0.06 * (hi - lo)


def _upward(values: Array, size: float) -> tuple[float, float]:
    """Return the range of an axis of values that are not negative."""
    lo, hi = _limits(values, size)
    top = hi if hi > 1e-6 * size else 0.1 * size
    return (0.0 if lo > 0.0 else -0.03 * top, top)


def _real_scale(axes: Axes, which: str, real: Array, largest: float) -> None:
    """Set the axis of the real parts: logarithmic far from zero if the ones that matter would be squeezed."""
    known = real[~np.isnan(real).any(axis=1)] if real.shape[1] else real[:0]
    size = float(np.max(np.abs(known), initial=0.0))
    near = float(np.max(np.abs(np.max(known, axis=1)), initial=0.0)) if known.size else 0.0
    lo, hi = _limits(real, largest)
    if which == "x":  # both sides are to be seen
        lo, hi = min(lo, -0.08 * (hi - lo)), max(hi, 0.08 * (hi - lo))
    scale, limit = (axes.set_yscale, axes.set_ylim) if which == "y" else (axes.set_xscale, axes.set_xlim)
    if 0.0 < SQUEEZED * near < size and near > 1e-8 * largest:
        threshold = 10.0 ** math.ceil(math.log10(near))
        scale("symlog", linthresh=threshold, linscale=1.5)
        axis = axes.yaxis if which == "y" else axes.xaxis
        axis.set_major_locator(SymmetricalLogLocator(base=10.0, linthresh=threshold))
        axis.set_major_formatter(FuncFormatter(lambda value, _: _minus(f"{value:g}")))
        lo, hi = float(np.min(known)), float(np.max(known))
        limit(1.4 * lo if lo < -threshold else -1.2 * threshold, 1.4 * hi if hi > threshold else 1.2 * threshold)
        text = f"{axis.get_label_text()}, logarithmic beyond ±{threshold:g}"
        axis.set_label_text(text, fontsize=min(FONT + 0.5, (FONT + 0.5) * 34 / len(text)))
    else:
        limit(lo, hi)


def _digits(value: float, span: float, digits: int) -> str:
    """Return a number; what is rounding compared with the range is 0."""
    return "0" if abs(value) < 1e-9 * span else _minus(f"{value:.{digits}g}")


def _minus(number: str) -> str:
    """Return a number with the sign that the numbers along the axes have."""
    return number.replace("-", "\N{MINUS SIGN}")


def _with_unit(value: float, span: float, label: Axis) -> str:
    number = _digits(value, span, 6)
    return f"{number} {label.unit}" if label.unit not in ("", "1") else number


def _text_width(text: str, size: float) -> float:
    """Return about how wide a text is, in points."""
    return 0.6 * size * len(text)


@dataclass
class _Labels:
    """Labels of points, placed where they hide neither each other nor curves; the limits of the axes are set before.

    Attributes
    ----------
    axes : Axes
    wanted : list of (x, y, text, marked)
    """

    axes: Axes
    wanted: list[tuple[float, float, str, bool]] = field(default_factory=list)

    def add(self, x: float, y: float, text: str, marked: bool = True) -> None:
        """Ask for a label at a point; a point that is marked keeps some distance."""
        self.wanted.append((x, y, text, marked))

    def draw(self) -> None:
        """Place the labels."""
        if not self.wanted:
            return
        scale = 72.0 / self.axes.figure.dpi
        frame = self.axes.get_window_extent()
        left, right, low, high = (scale * v for v in (frame.x0, frame.x1, frame.y0, frame.y1))
        busy = self._busy(scale)
        taken: list[tuple[float, float, float, float]] = []
        points = scale * self.axes.transData.transform([(x, y) for x, y, *_ in self.wanted])
        taken += [(px - 4.0, py - 4.0, px + 4.0, py + 4.0) for px, py in points]
        for (x, y, text, marked), (px, py) in zip(self.wanted, points, strict=True):
            w, h = _text_width(text, FONT) + 2.0, FONT + 3.0
            best, lowest = (0.0, 0.0), math.inf
            for far in (7.0, 18.0, 32.0, 50.0) if marked else (1.0, 4.0):
                for ux, uy in ((1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1)):
                    cx, cy = px + ux * (far + 0.5 * w), py + uy * (far + 0.5 * h)
                    if ux and uy:
                        cx, cy = px + ux * (0.7 * far + 0.5 * w), py + uy * (0.7 * far + 0.5 * h)
                    box = (cx - 0.5 * w, cy - 0.5 * h, cx + 0.5 * w, cy + 0.5 * h)
                    hidden = (busy > box[:2]) & (busy < box[2:])
                    cost = 1.0 * float(np.count_nonzero(hidden.all(axis=1))) + 0.25 * far
                    cost += 60.0 * sum(
                        box[0] < t[2] and t[0] < box[2] and box[1] < t[3] and t[1] < box[3] for t in taken
                    )
                    cost += 200.0 * (box[0] < left or box[2] > right or box[1] < low or box[3] > high)
                    if cost < lowest:
                        best, lowest, place = (cx - px, cy - py), cost, box
            taken.append(place)
            distant = math.hypot(*(max(abs(o) - 0.5 * s, 0.0) for o, s in zip(best, (w, h), strict=True))) > 12.0
            self.axes.annotate(
                text, (x, y), best, textcoords="offset points", ha="center", va="center", zorder=6,
                bbox={"boxstyle": "square,pad=0.1", "facecolor": "w", "alpha": 0.8, "linewidth": 0},
                arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": "0.3"} if distant else None,
            )  # fmt: skip

    def _busy(self, scale: float) -> Array:
        """Return points (in typographical points) along all curves of the axes."""
        found = []
        for line in self.axes.get_lines():
            xy = scale * line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float))
            xy = xy[np.isfinite(xy).all(axis=1)]
            if line.get_linestyle() == "None":  # markers
                found += [xy + shift for shift in (0.0, *np.eye(2) * 3.0, *np.eye(2) * -3.0)] * 2
                continue
            if len(xy) < 2:
                continue
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
            even = np.linspace(0.0, along[-1], min(int(along[-1] / 3.0) + 2, 5000))
            found.append(np.column_stack([np.interp(even, along, xy[:, 0]), np.interp(even, along, xy[:, 1])]))
        return np.concatenate(found) if found else np.zeros((0, 2))
