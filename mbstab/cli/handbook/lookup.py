"""Search in the manual: by paragraph, item or row, whichever holds all the words."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cache
from unicodedata import combining, normalize

from mbstab.errors import UsageError, nearest
from mbstab.records import dataclass


@dataclass(frozen=True)
class Place:
    """A piece of the manual: a paragraph, an item of a list, a row of a table or an entry of a listing.

    Attributes
    ----------
    topic, heading, text : str
        Where it stands, and the text in one line.
    """

    topic: str
    heading: str
    text: str

    def holds(self, words: list[str]) -> bool:
        """Whether all words are in it or its heading, and at least one in the text itself."""
        return all(self.says(word) for word in words) and any(_said(self.text, word) for word in words)

    def says(self, word: str) -> bool:
        """Whether a word is in it or its heading."""
        return _said(f"{self.heading} {self.text}", word)

    def explains(self, words: list[str]) -> bool:
        """Whether it begins with the words, as a definition does, or is a row of a table that is headed by them."""
        told = re.match(r"\|([^|]*)\||\* `([^`]*)`|\* \*\*([^*]*)\*\*", self.text)
        if told:
            return all(_said(told[told.lastindex or 0], word) for word in words)
        return respelled(self.text.lstrip("* ")).startswith(respelled(" ".join(words)))


def plain(text: str) -> str:
    """Return text in small letters without accents, which a query may leave out."""
    return "".join(c for c in normalize("NFKD", text.lower()) if not combining(c))


SPELLINGS = (
    (r"(?<=\w{3})our", "or"),  # colour, color
    (r"(?<=\w{2}[bt])(ere|er|re)", "r"),  # centred, centered
    (r"ll(?=ed|er|ing)", "l"),  # modelling, modeling
    (r"\btire", "tyre"),
    ("sk", "sc"),  # disk, disc
    (r"(?<=[a-z]{2}[^\Wisu])s\b", ""),  # gears, gear
    ("z", "s"),  # linearize, linearise
)
"""Patterns that make one of two spellings, the same in a query and in a text, and what stands for them."""


def respelled(text: str) -> str:
    """Return plain text in which British and American spellings, one and many, are the same."""
    text = plain(text)
    for pattern, common in SPELLINGS:
        text = re.sub(pattern, common, text)
    return text


@cache
def _forms(text: str) -> tuple[str, str, str]:
    """Return plain text, respelled text, and that without hyphens in words: sub-critical is subcritical."""
    common = respelled(text)
    return plain(text), common, re.sub(r"(?<=\w)-(?=\w)", "", common)


def _said(text: str, word: str) -> bool:
    """Whether a word of a text begins with a word, in one of the spellings of both."""
    return any(map(_begins, _forms(text), _forms(word)))


def _begins(text: str, word: str) -> bool:
    """Whether a word of a text, or a part of it after an underscore, begins with a word."""
    at = text.find(word)
    while at > 0 and word[:1].isalnum() and text[at - 1].isalnum():
        at = text.find(word, at + 1)
    return at >= 0


def places(topic: str, text: str) -> Iterator[Place]:
    """Yield the pieces of a page."""
    heading = topic
    for block in re.split(r"\n\s*\n", text):
        for piece in re.split(r"\n(?=\* |\||\s*[\w ,()-]+: |- )", block):
            joined = " ".join(piece.split())
            if re.match(r"#+ ", joined):
                heading, _, joined = joined.lstrip("# ").partition("\n")
                yield Place(topic, heading, heading)
            elif joined and not joined.startswith("```") and not re.fullmatch(r"[|\s:-]+", joined):
                yield Place(topic, heading, joined)


def found_places(every: Sequence[Place], query: str) -> list[Place]:
    """Return the pieces that hold all words of a query, those that explain it first.

    If no piece holds all, those with the most words stand for them, provided that there are at least two.

    Raises
    ------
    UsageError
        If there is none.
    """
    words = plain(query).split()
    if not words:
        raise UsageError("--search needs a word, such as --search damping")
    found = [place for place in every if place.holds(words)] or _nearly(every, words)
    if not found:
        known = sorted({word for place in every for word in re.findall(r"[\w-]{3,}", plain(place.text))})
        alone = [word for word in words if not any(_said(place.text, word) for place in every)]
        near = _nearest(alone[0], known) if alone else ""
        each = " or ".join(repr(word) for word in words if word not in alone)
        hint = "use other words; mbstab manual lists the topics"
        if near or each:
            hint = f"did you mean {near!r}?" if near else f"search for {each} alone"
        raise UsageError(f"the manual has nothing about {query!r}\nhint: {hint}")
    return sorted(found, key=lambda place: not place.explains(words))


def _nearly(every: Sequence[Place], words: list[str]) -> list[Place]:
    """Return the pieces that hold the most words, at least two; those of up to three letters do not count."""
    told = [word for word in words if len(word) > 3]
    counts = [sum(place.says(word) for word in told) for place in every]
    most = max(counts, default=0)
    return [place for place, count in zip(every, counts, strict=True) if count == most] if most > 1 else []


def _nearest(word: str, known: list[str]) -> str:
    """Return the nearest known word with the same first letter."""
    return nearest(word, [other for other in known if other[0] == word[0]])
