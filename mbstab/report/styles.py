"""Text whose parts have styles, by what they mean: a verdict, a row that grows, an error.

`Text` is a string, and as such the text alone: files and pipes get that. The terminal gives each style its look.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

Style = Literal[
    "stable", "marginal", "unstable", "undecided",  # verdicts
    "grows", "open", "faint",  # rows: what grows, what is undecided, what is beside the point
    "good", "bad", "title", "error", "warning", "hint", "place",
    "file",  # its name, to which a terminal adds a link
]  # fmt: skip


class Text(str):
    """A string with styles.

    Attributes
    ----------
    spans : tuple of (int, int, Style)
        First character, end, and style of the parts that have one, in order and apart from each other.
    """

    spans: tuple[tuple[int, int, Style], ...]

    def __new__(cls, text: str, spans: Iterable[tuple[int, int, Style]] = ()) -> Text:
        """Return the text with its spans."""
        made = super().__new__(cls, text)
        made.spans = tuple(spans)
        return made


def styled(text: str, style: Style | None) -> Text:
    """Return a text in one style; None: without any."""
    return Text(text, [(0, len(text), style)] if style is not None and text else [])


def joined(parts: Iterable[str], between: str = "\n", end: str = "") -> Text:
    """Return texts as one, with a text between each two and one at the end; each keeps its styles."""
    parts, spans, at = list(parts), [], 0
    for part in parts:
        spans += [(at + first, at + stop, style) for first, stop, style in getattr(part, "spans", ())]
        at += len(part) + len(between)
    return Text(between.join(parts) + end, spans)


def document(parts: Iterable[str]) -> Text:
    """Return texts as paragraphs of an answer, which ends with one line break."""
    whole = joined(parts)
    return Text(whole.rstrip("\n") + "\n", whole.spans)
