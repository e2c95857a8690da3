"""The pattern of the descriptor pencil s E - A, its blocks labelled by body and joint."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mbstab.analysis.linear.linearize import Linearization
from mbstab.report.picture_sizes import FONT, scaled
from mbstab.report.pictures.drawing import RIGHT, draw_title, house_style, picture_height, picture_width, title_lines

LABELS, HEAD, BELOW, GAP = 1.35, 0.4, 1.2, 0.25
"""Room for labels beside, above and below a panel, and between panels (inches on a page)."""

NARROW = 5.0
"""Panels of narrower pictures are below each other (inches on a page)."""

NAMED = 18
"""Groups of a block that are named; of more there are only the blocks."""

LETTERS = 14
"""Characters of a name that fit."""

Block = tuple[str, list[tuple[str, int]]]
"""What a block is called, and its groups with their sizes."""


def pencil_pattern(linear: Linearization, title: str) -> Figure:
    """Return where A and E have entries, over the variables Δq, Δν, Δu and the equations that belong to them."""
    A, E = linear.pencil()
    bodies = _sizes([name.partition(".")[0] for name in linear.names])
    joints = _sizes([row.name for row in linear.rows])
    over: list[Block] = [("Δq", bodies), ("Δν", joints), ("Δu", bodies)]
    beside: list[Block] = [("rates", bodies), ("motion", bodies), ("constraints", joints)]
    with house_style():
        lines = title_lines(title)[:2]
        wide, above = picture_width(), 0.2 + 0.2 * len(lines)
        columns = 1 if wide < NARROW else 2
        side = (wide - LABELS - RIGHT - GAP * (columns - 1)) / columns
        if picture_height():
            side = min(side, picture_height() - above - HEAD - BELOW)
        total = picture_height() or above + (2 // columns) * (HEAD + side + BELOW)
        figure = Figure(figsize=(scaled(wide), scaled(total)))
        draw_title(figure, lines)
        for k, (name, matrix) in enumerate((("A", A), ("E", E))):
            row, column = divmod(k, columns)
            left, low = LABELS + column * (side + GAP), total - above - (row + 1) * (HEAD + side) - row * BELOW
            axes = figure.add_axes((left / wide, low / total, side / wide, side / total))
            _draw(axes, np.asarray(matrix), name, 72.0 * scaled(side))
            _label(axes, "x", over, 72.0 * side, named=True)
            _label(axes, "y", beside, 72.0 * side, named=column == 0)
        return figure


def _sizes(owners: Sequence[str]) -> list[tuple[str, int]]:
    """Return the names of neighbours that belong together, and how many these are."""
    return [(name, len(list(group))) for name, group in groupby(owners)]


def _draw(axes: Axes, matrix: Any, name: str, side: float) -> None:
    """Mark the entries that are not zero, in a panel with a side of so many points."""
    count = len(matrix)
    i, j = np.nonzero(matrix)
    axes.plot(j + 0.5, i + 0.5, "s", color="k", markersize=max(0.5, 0.8 * side / count), markeredgewidth=0, zorder=3)
    axes.set_xlim(0, count)
    axes.set_ylim(count, 0)
    axes.set_title(f"{name}: {count} × {count}, {len(i)} not zero", fontsize=scaled(FONT), pad=scaled(16.0))


def _label(axes: Axes, which: str, blocks: Sequence[Block], side: float, named: bool) -> None:
    """Draw the borders of blocks and groups along an axis of so many points, and write their names."""
    line = axes.axvline if which == "x" else axes.axhline
    axis = axes.xaxis if which == "x" else axes.yaxis
    every = sum(len(groups) for _, groups in blocks) <= 3 * NAMED
    small = FONT - 1.0
    apart = (small + 1.0) / side * sum(size for _, groups in blocks for _, size in groups)
    places, names, at, last = list[float](), list[str](), 0, -apart
    for block, groups in blocks:
        start = at
        for number, (name, size) in enumerate(groups):
            middle = at + 0.5 * size
            # Names that would hide the one before are left out.
            if every and middle - last >= apart:
                shown = name if len(name) <= LETTERS else name[: LETTERS - 1] + "…"
                places.append(middle)
                names.append(f"{block}  {shown}" if number == 0 and which == "y" else shown)
                last = middle
            if every:
                line(at, color="0.85", linewidth=0.5, zorder=1)
            at += size
        if at > start:
            middle = 0.5 * (start + at)
            if which == "x":
                text = axes.get_xaxis_transform()
                axes.text(middle, 1.01, block, transform=text, ha="center", va="bottom", fontsize=scaled(small))
            if not every:
                places.append(middle)
                names.append(f"{at - start}" if which == "x" else f"{block} ({at - start})")
        line(at, color="0.35", linewidth=0.9, zorder=2)
    axis.set_ticks(places, names if named else [""] * len(places))
    axes.tick_params(
        axis="x" if which == "x" else "y", length=2.0, labelsize=scaled(small), rotation=90 if which == "x" else 0
    )
