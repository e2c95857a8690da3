"""Plain tables as wide as their numbers need, and numbers as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import zip_longest
from textwrap import wrap
from typing import Any

from mbstab.analysis.verdict.wording import known
from mbstab.report import table_width, width
from mbstab.report.styles import Style, Text, joined, styled

GAP = 2
"""Blanks between columns."""


def wrap_lines(text: str, first: str = "", rest: str = "", hyphens: bool = True) -> list[str]:
    """Return a paragraph in lines that fit the terminal, with indents of the first one and of the rest."""
    return wrap(text, width(), initial_indent=first, subsequent_indent=rest, break_on_hyphens=hyphens)


def fill_lines(text: str) -> list[str]:
    """Return a paragraph in lines with a hanging indent, which are not broken at hyphens."""
    return wrap_lines(text, "", "  ", hyphens=False)


def table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int] = (), styles: Sequence[Style | None] = ()
) -> Text:
    """Return an aligned table; columns in `left` are flush left, the others flush right.

    Columns that do not fit in `table_width` follow below, with the first column repeated; texts that do not fit are
    wrapped. `styles` are those of the rows.
    """
    first = max(map(_width, (heads[0], *(row[0] for row in rows))))
    room = max(table_width() - first - GAP, table_width() // 2)
    texts = [i for i in left if i]
    rows = [["\n".join(wrap(x, room)) if i in texts else x for i, x in enumerate(row)] for row in rows]
    widths = [max(map(_width, column)) for column in zip(heads, *rows, strict=True)]
    blocks = []
    for block in _blocks(widths):
        cells = [[row[i] for i in block] for row in rows]
        flush = [n for n, i in enumerate(block) if i in left]
        blocks.append(_aligned([heads[i] for i in block], cells, flush, styles))
    return joined(blocks)


def _width(cell: str) -> int:
    return max(map(len, cell.split("\n")))


def _blocks(widths: Sequence[int]) -> list[list[int]]:
    """Return the columns that are side by side, the first one in each block."""
    blocks, used = [[0]], widths[0]
    for i, wide in enumerate(widths[1:], 1):
        if used + GAP + wide > table_width() and len(blocks[-1]) > 1:
            blocks.append([0])
            used = widths[0]
        blocks[-1].append(i)
        used += GAP + wide
    return blocks


def _aligned(
    heads: Sequence[str], rows: Sequence[Sequence[str]], left: Sequence[int], styles: Sequence[Style | None]
) -> Text:
    """Return a table with its columns side by side; heads are aligned at the bottom, cells at the top."""
    widths = [max(map(_width, column)) for column in zip(heads, *rows, strict=True)]
    height = max(head.count("\n") for head in heads)
    raised = ["\n" * (height - head.count("\n")) + head for head in heads]
    rule = styled("─" * (sum(widths) + GAP * (len(widths) - 1)), "faint")
    lines: list[str] = [*(line.rstrip() for line in _lines(raised, widths, left)), rule]
    for row, style in zip_longest(rows, styles):
        lines += [styled(line.rstrip(), style) for line in _lines(row, widths, left)]
    return joined(lines, end="\n")


def _lines(cells: Sequence[str], widths: Sequence[int], left: Sequence[int]) -> list[str]:
    """Return the lines of a row of cells."""
    columns = [
        [f"{line:{'<' if i in left else '>'}{width}}" for line in cell.split("\n")]
        for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
    ]
    filled = zip_longest(*columns, fillvalue=None)
    return [
        (" " * GAP).join(" " * width if x is None else x for x, width in zip(line, widths, strict=True))
        for line in filled
    ]


def number(x: float, digits: int = 6, bound: float = 0.0) -> str:
    """Return a number with the given significant digits, none below an error bound; a dash where there is none."""
    return "-" if math.isnan(x) else "inf" if x == math.inf else known(x, digits, bound)


def eigenvalue(s: complex) -> str:
    """Return an eigenvalue with ten significant digits; a pair as ±."""
    if s.imag == 0.0:
        return f"{s.real:.10g}"
    # A real part that is round-off compared with the imaginary part is not shown with ten digits.
    real = f"{s.real:.10g}" if abs(s.real) > 1e-10 * abs(s) or not s.real else f"{s.real:.1e}"
    return f"{real} ± {abs(s.imag):.10g}i"


def decimals(x: Any, digits: int) -> dict[str, str]:
    """Return a ball as midpoint and radius in decimal; the radius covers the rounding of the midpoint."""
    middle, radius, exponent = (int(part) for part in x.mid_rad_10exp(digits))
    return {"midpoint": _scientific(middle, exponent), "radius": _scientific(radius, exponent)}


def _scientific(mantissa: int, exponent: int) -> str:
    if mantissa == 0:
        return "0"
    digits = str(abs(mantissa)).rstrip("0")
    shift = exponent + len(str(abs(mantissa))) - 1
    text = digits[0] + ("." + digits[1:] if len(digits) > 1 else "")
    return f"{'-' if mantissa < 0 else ''}{text}e{shift:+d}" if shift else f"{'-' if mantissa < 0 else ''}{text}"
