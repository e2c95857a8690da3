"""A page of the manual on a terminal, or as plain text of 80 columns."""

from __future__ import annotations

import re
import shutil
import textwrap

from mbstab.report import WIDTH

_TABLE = re.compile(r"(?:^\|.*\|\n)+", flags=re.M)


def plain(text: str) -> str:
    """Return a page as it is, but for tables that are wider than the terminal: their rows are listed."""
    return _TABLE.sub(lambda found: _narrow(found.group()), text)


def _narrow(table: str) -> str:
    if max(map(len, table.splitlines())) <= WIDTH:
        return table
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines()]
    heads, lines = rows[0], []
    if len(heads) == 2:
        return "\n".join(line for row in rows[2:] for line in _wrapped(f"{row[0]}: {row[1]}", "* ")) + "\n"
    for row in rows[2:]:
        lines += _wrapped(row[0], "* ")
        for head, cell in zip(heads[1:], row[1:], strict=True):
            lines += _wrapped(f"{head}: {cell}", "  - ") if cell else []
    return "\n".join(lines) + "\n"


def _wrapped(text: str, mark: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=mark, subsequent_indent=" " * len(mark), break_on_hyphens=False)


def rendered(text: str) -> str:
    """Return a page with colours and line drawings for a terminal, as wide as that but not wider than 80 columns."""
    from rich.console import Console
    from rich.markdown import Markdown

    width = min(WIDTH, shutil.get_terminal_size().columns)
    console = Console(width=width, force_terminal=True, highlight=False)
    with console.capture() as capture:
        console.print(Markdown(text))
    return capture.get()
