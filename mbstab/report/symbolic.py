"""Symbolic matrices as text and as LaTeX."""

from __future__ import annotations

from mbstab.analysis.linear.symbolic import SymbolicBlocks
from mbstab.model.schema import Model
from mbstab.report import table_width

NAMES = {"M": "mass", "R": "damping", "K": "stiffness"}


def symbolic_text(result: SymbolicBlocks, model: Model) -> str:
    """Return the blocks as text, wide ones continued below (↪); zero blocks are written O."""
    import sympy

    lines: list[str] = []
    for name, block in result.blocks.items():
        shape = f"{block.rows} × {block.cols}"
        if block.is_zero_matrix:
            lines.append(f"{name} = O  ({shape})")
            continue
        lines.append(f"{name} =")
        lines.append(sympy.pretty(block, use_unicode=True, num_columns=table_width()))
    return "\n".join(lines) + "\n"


def symbolic_latex(result: SymbolicBlocks, model: Model) -> str:
    """Return the blocks as LaTeX equations."""
    import sympy

    lines = []
    for name, block in result.blocks.items():
        letter, _, index = name.partition("_")
        head = rf"\bar{{\mathbf{{{letter}}}}}_{{{index[0]},{index[1]}}}"
        body = r"\mathbf{O}" if block.is_zero_matrix else sympy.latex(block)
        lines += [r"\begin{equation}", f"{head} = {body}", r"\end{equation}"]
    return "\n".join(lines) + "\n"
