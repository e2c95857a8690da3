"""The references that a sweep found, over its parameter: where they are stable, turn back and lose stability."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.sweep.sweep import Sweep
from mbstab.compiler.system import Array
from mbstab.errors import UsageError, alternatives
from mbstab.records import dataclass
from mbstab.report.pictures.curves import INK, THIN, decimated
from mbstab.report.pictures.dense_curves import slopes
from mbstab.report.pictures.drawing import CRITICAL_STYLE, draw_legend, house_style, legend_marker, no_answer_patch
from mbstab.report.pictures.over_parameter import panels_over_parameter
from mbstab.report.pictures.scales import Axis, axis_range, typeset
from mbstab.report.pictures.sweep_curves import SweepCurves

CONSTANT = 1e-9
"""Curves that change by less than this fraction of the largest of their unit do not depend on the parameter."""

MOST = len(INK)
"""Curves in a panel, unless others are asked for."""

PANELS = {
    "m": "positions", "rad": "angles", "m/s": "velocities", "rad/s": "angular velocities", "1": "states",
    "1/s": "rates of states",
}  # fmt: skip
"""What is in a panel, by the unit, in the order of the panels."""

LONGEST = 24
"""Characters of the names that stand at an axis."""

BETWEEN = 16
"""Points between two points of a sweep."""

DENSE = 2000
"""So many points need none between them."""

STYLES: dict[int, Any] = {0: "-", 1: (0, (4.0, 1.8)), -1: (0, (1.0, 1.6))}
"""Lines of stable and unstable references, and of those whose verdict is open."""


@dataclass(frozen=True)
class _Piece:
    """A part of a path between critical values, or beside a fold: stable (0), unstable (1) or open (−1)."""

    x: Array
    columns: dict[str, Array]
    state: int


def shown_names(result: Sweep, asked: Sequence[str]) -> tuple[list[str], int]:
    """Return which coordinates and rates are drawn, and how many others depend on the parameter as well.

    Raises
    ------
    UsageError
        If one that is asked for does not exist, or none depends on the parameter.
    """
    paths = (result, *result.beyond)
    units = _units(result)
    columns = {name: np.concatenate([path.found.get(name, 0.0 * path.values) for path in paths])
               for path in paths for name in path.found}  # fmt: skip
    for name in asked:
        if name not in columns:
            hint = alternatives(name, columns, "coordinates")
            raise UsageError(f"--coordinate {name}: no such coordinate\nhint: {hint}")
    if asked:
        return list(dict.fromkeys(asked)), 0
    values = np.concatenate([path.values for path in paths])
    columns = {name: x for name, x in columns.items() if not _is_parameter(x, values)}
    chosen: list[str] = []
    left = 0
    for unit in _panels(result):
        own = {name: x[np.isfinite(x)] for name, x in columns.items() if units[name] == unit}
        size = max((float(np.max(np.abs(x), initial=0.0)) for x in own.values()), default=0.0)
        varying = {name: x for name, x in own.items() if len(x) and float(np.ptp(x)) > CONSTANT * size}
        distinct: list[str] = []
        for name, x in sorted(varying.items(), key=lambda item: -float(np.ptp(item[1]))):
            if not any(np.max(np.abs(x - varying[other])) <= CONSTANT * size for other in distinct):
                distinct.append(name)
        chosen += distinct[:MOST]
        left += len(varying) - len(distinct[:MOST])
    if not chosen and any(np.any(np.isfinite(x)) for x in columns.values()):
        raise UsageError(
            f"--plot path: no coordinate of the reference depends on {result.parameter}\n"
            "hint: --coordinate draws one all the same; --plot map shows the eigenvalues"
        )
    return chosen, left


def _is_parameter(x: Array, values: Array) -> bool:
    """Whether a column is the parameter itself, or its opposite, as a rate that is declared."""
    known = np.isfinite(x)
    size = CONSTANT * float(np.max(np.abs(values), initial=0.0))
    return any(bool(np.all(np.abs(x - sign * values)[known] <= size)) for sign in (1.0, -1.0))


def _units(result: Sweep) -> dict[str, str]:
    """Return the units of what was found, by name."""
    return {name: unit for path in (result, *result.beyond) for name, unit in path.units.items()}


def _panels(result: Sweep) -> list[str]:
    """Return the units of the panels: those of positions and speeds first, then those of further states."""
    return list(dict.fromkeys([*PANELS, *_units(result).values()]))


def bifurcation(result: Sweep, label: Axis | str, title: str, asked: Sequence[str] = ()) -> Figure:
    """Return the coordinates and rates of the references over the parameter, stable ones as full lines.

    Critical values are vertical lines with their kinds, and marks on the curves. Curves go round a fold.

    Parameters
    ----------
    result : Sweep
    label : Axis or str
    title : str
    asked : sequence of str
        What is drawn; if nothing is said what the parameter changes most, up to three in each unit.
    """
    label = Axis.read(label)
    names, left = shown_names(result, asked)
    of = _units(result)
    units = [unit for unit in _panels(result) if any(of[name] == unit for name in names)]
    with house_style():
        curves = SweepCurves(result, label)
        groups = [[name for name in names if of[name] == unit] for unit in units]
        heads = [_head(group, unit) for group, unit in zip(groups, units, strict=True)]
        figure, panels, unlabelled = panels_over_parameter(curves, title, heads or ["coordinates"], shaded=False)
        if not names:
            panels[0].text(
                0.5, 0.5, "no coordinate depends on the parameter", transform=panels[0].transAxes, ha="center"
            )
        pieces = _pieces(result, curves, label.factor, names)
        inks = {name: INK[k % len(INK)] for group in groups for k, name in enumerate(group)}
        for axes, group in zip(panels, groups, strict=False):
            _draw(axes, pieces, {name: inks[name] for name in group}, curves)
        draw_legend(figure, _entries(pieces, groups, inks, curves, unlabelled, left))
        return figure


def _head(group: Sequence[str], unit: str) -> str:
    """Return what the axis of a panel is called: the names of its curves if they are short, or their kind."""
    text = ", ".join(group)
    return f"{text if len(text) <= LONGEST else PANELS.get(unit, 'states')} ({typeset(unit)})".removesuffix(" ()")


def _draw(axes: Axes, pieces: Sequence[_Piece], inks: dict[str, str], curves: SweepCurves) -> None:
    """Draw the curves of a panel, and where they lose stability."""
    values = np.concatenate([piece.columns[name] for piece in pieces for name in inks] or [np.zeros(0)])
    finite = np.abs(values[np.isfinite(values)])
    axes.set_ylim(axis_range(values, float(np.max(finite, initial=0.0)) or 1.0))
    critical = [group[0].value for group in curves.marked]
    for name, ink in inks.items():
        for piece in pieces:
            style: dict[str, Any] = {
                "color": ink,
                "linewidth": THIN,
                "linestyle": STYLES[piece.state],
                "dash_capstyle": "butt",
            }
            points = decimated(piece.x, piece.columns[name], logarithmic=curves.label.logarithmic)
            axes.plot(*points, zorder=3, **style)
            for k in (0, -1):
                if any(abs(piece.x[k] - value) <= 1e-9 * curves.span for value in critical):
                    axes.plot(piece.x[k], piece.columns[name][k], "D", color="k", markerfacecolor="w", ms=5, zorder=4)


def _pieces(result: Sweep, curves: SweepCurves, factor: float, names: Sequence[str]) -> list[_Piece]:
    """Return the parts of all paths, and around the folds between them what joins them."""
    paths = list(zip((result, *result.beyond), (curves, *curves.others), strict=True))
    found = [piece for path, own in paths for piece in _along(path, own, factor, names)]
    for earlier, later in combinations((result, *result.beyond), 2):
        ends = [c.value for c in earlier.critical if c.kind in ("fold", "branch point")] + [earlier.start]
        if later.start is not None and later.start in ends:
            found += _around(earlier, later, later.start / factor, factor, names)
    return found


def _columns(path: Sweep, factor: float, names: Sequence[str]) -> tuple[Array, dict[str, Array], Index]:
    """Return ascending values with an answer, the columns there, and numbers that differ between runs of neighbours."""
    order = np.argsort(path.values)
    columns = {name: path.found.get(name, 0.0 * path.values)[order] for name in names}
    known = np.flatnonzero(np.isfinite(np.array([*columns.values()])).all(axis=0)) if names else np.arange(0)
    run: Index = np.cumsum(np.diff(known, prepend=known[:1]) > 1)
    return path.values[order][known] / factor, {name: x[known] for name, x in columns.items()}, run


def _along(path: Sweep, own: SweepCurves, factor: float, names: Sequence[str]) -> list[_Piece]:
    """Return the parts of a path between its critical values, smooth between its points."""
    x, columns, run = _columns(path, factor, names)
    critical = [group[0].value for group in own.critical]
    ranges = list(own.ranges())
    found: list[_Piece] = []
    for number in np.unique(run).tolist():
        inside = run == number
        part = x[inside]
        if len(part) < 2:
            continue
        many = 1 if len(part) > DENSE else BETWEEN
        fine = np.interp(np.arange(0, len(part) - 1 + 0.5 / many, 1 / many), np.arange(len(part)), part)
        # Where a critical value is a point but for rounding, the point is taken.
        ends = [
            part[np.argmin(np.abs(part - c))] if np.min(np.abs(part - c)) <= 1e-9 * own.span else c for c in critical
        ]
        edges = np.unique([part[0], part[-1], *(c for c in ends if part[0] < c < part[-1]),
                           *(v for a, b, _ in ranges for v in (a, b) if part[0] < v < part[-1])])  # fmt: skip
        values = np.stack([column[inside] for column in columns.values()], axis=1)
        for a, b in pairwise(edges.tolist()):
            at = np.concatenate([[a], fine[(fine > a) & (fine < b)], [b]])
            middle = 0.5 * (a + b)
            state = next((state for low, high, state in ranges if low <= middle <= high), 0)
            found.append(_Piece(at, dict(zip(names, _smooth(part, values, at).T, strict=True)), state))
    return found


def _smooth(x: Array, y: Array, at: Array) -> Array:
    """Return the values of curves between points, shape (points, curves): cubic, and linear between two points."""
    from scipy.interpolate import CubicHermiteSpline

    steps = np.diff(x)[:, None]
    chord = np.diff(y, axis=0) / steps
    slope = slopes(steps, chord) if len(x) > 2 else np.repeat(chord, 2, axis=0)
    return np.asarray(CubicHermiteSpline(x, y, slope)(at))


def _around(earlier: Sweep, later: Sweep, fold: float, factor: float, names: Sequence[str]) -> list[_Piece]:
    """Return what joins two paths on the same side of a fold, or of the place where both branch off from another one.

    Over the root of the distance from it, solutions are smooth.
    """
    sides, states = [], []
    for path in (earlier, later):
        x, columns, _ = _columns(path, factor, names)
        if len(x) < 2:
            return []
        ends = slice(None, 2) if abs(x[0] - fold) < abs(x[-1] - fold) else slice(-1, -3, -1)
        sides.append((x[ends], {name: column[ends] for name, column in columns.items()}))
        states.append(int(np.sign(path.unstable[np.argmin(np.abs(path.values - factor * x[ends][0]))])))
        if np.any((x - fold) * (sides[0][0][0] - fold) < 0.0):
            return []
    sign = np.sign(sides[0][0][0] - fold)
    roots = np.concatenate([side * np.sqrt(np.abs(x - fold)) for side, (x, _) in zip((-1.0, 1.0), sides, strict=True)])
    found = []
    for state, side, (x, _) in zip(states, (-1.0, 1.0), sides, strict=True):
        root = side * np.sqrt(abs(x[0] - fold)) * np.linspace(1.0, 0.0, 2 * BETWEEN)
        columns = {}
        for name in names:
            known = np.concatenate([columns_[name] for _, columns_ in sides])
            columns[name] = np.polyval(np.polyfit(roots, known, 3), root)
        found.append(_Piece(fold + sign * root**2, columns, state))
    return found


def _entries(
    pieces: Sequence[_Piece],
    groups: Sequence[Sequence[str]],
    inks: dict[str, str],
    curves: SweepCurves,
    unlabelled: int,
    left: int,
) -> list[Artist]:
    """Return the entries of the legend."""
    # Names belong to colours, lines to stability; a single short name stands at the axis of its panel.
    handles: list[Artist] = [
        Patch(facecolor=inks[name], label=name)
        for group in groups
        for name in group
        if len(group) > 1 or len(name) > LONGEST
    ]
    shade = "0.4" if len(set(inks.values())) > 1 else INK[0]
    words = {0: "stable", 1: "unstable", -1: "undecided"}
    for state in sorted({piece.state for piece in pieces}, key=lambda k: (k < 0, k)):
        handles.append(Line2D([], [], color=shade, linewidth=THIN, linestyle=STYLES[state], label=words[state]))
    if curves.marked:
        text = "critical value" + (f" ({unlabelled} without label)" if unlabelled else "")
        handles += [Line2D([], [], color="k", linewidth=1.0, linestyle=CRITICAL_STYLE, label=text)]
        handles += [legend_marker("D", 5.0, "where it is critical")]
    if np.any(curves.unanswered):
        handles.append(no_answer_patch(curves.gap))
    if left:
        handles.append(Line2D([], [], linestyle="", label=f"{left} more depend on it, see --coordinate"))
    return handles
