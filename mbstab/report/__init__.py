"""Results as text and files."""

from contextvars import ContextVar

WIDTH = 80
"""Largest width of wrapped text and of tables, in columns."""

NARROWEST = 40
"""Width below which nothing is narrower."""

_WIDTH = ContextVar("width", default=WIDTH)


def width() -> int:
    """Return the width of wrapped text and of tables, in columns: that of the terminal, but at most `WIDTH`."""
    return _WIDTH.get()


def set_width(columns: int) -> None:
    """Write for a terminal of that many columns."""
    _WIDTH.set(min(max(columns, NARROWEST), WIDTH))
