"""Results as text and files."""

from contextvars import ContextVar

WIDTH = 80
"""Largest width of wrapped text, and that of tables without a terminal, in columns."""

NARROWEST = 40
"""Width below which nothing is narrower."""

_WIDTH = ContextVar("width", default=WIDTH)


def table_width() -> int:
    """Return the width of tables, in columns: that of the terminal."""
    return _WIDTH.get()


def width() -> int:
    """Return the width of wrapped text, in columns: that of the terminal, but at most `WIDTH`."""
    return min(table_width(), WIDTH)


def set_width(columns: int) -> None:
    """Write for a terminal of that many columns."""
    _WIDTH.set(max(columns, NARROWEST))
