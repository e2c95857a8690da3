"""Sizes of pictures: a column or the width of a page of a journal, a slide.

Lengths in the code of pictures are those of a page; `scaled` turns them into those of the size that is drawn.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from mbstab.records import dataclass

FONT = 9.0
"""Size of text on a page (points)."""

MM = 1.0 / 25.4
"""Inches."""

LONGEST = 225.0 * MM
"""Height of the text of a page (inches): pictures with many panels are not higher."""


@dataclass(frozen=True)
class Size:
    """A size of pictures.

    Attributes
    ----------
    width : float
        Inches.
    height : float
        Inches; 0: what the content needs.
    text : float
        Size of text (points).
    dpi : int
        Pixels of an inch of a PNG.
    """

    width: float
    height: float
    text: float
    dpi: int


SIZES = {
    "column": Size(85.0 * MM, 0.0, 8.0, 300),
    "page": Size(170.0 * MM, 0.0, FONT, 200),
    "slide": Size(254.0 * MM, 143.0 * MM, 12.0, 150),
}
"""Sizes by name."""

_current: ContextVar[Size] = ContextVar("size", default=SIZES["page"])


@contextmanager
def sized(name: str) -> Iterator[None]:
    """Draw and save pictures in one of `SIZES`."""
    token = _current.set(SIZES[name])
    try:
        yield
    finally:
        _current.reset(token)


def size() -> Size:
    """Return the size in which pictures are drawn."""
    return _current.get()


def scaled(length: float) -> float:
    """Return a length or a size of text of a page in the size in which pictures are drawn."""
    return length * size().text / FONT
