"""Verdicts as text: the word with its symbol, and what it rests on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbstab.model.words import ASYMPTOTIC, ASYMPTOTIC_UP_TO, MARGINAL, STABLE, STABLE_UP_TO, UNSTABLE
from mbstab.report.styles import Style, Text, joined, styled
from mbstab.report.tables import wrap_lines

if TYPE_CHECKING:
    from mbstab.analysis.verdict.rule import Verdict

SYMBOLS: dict[Style, str] = {"stable": "✔", "marginal": "●", "unstable": "✘", "undecided": "?"}
"""The symbol of each style of verdicts."""

_STYLES: dict[str, Style] = {
    ASYMPTOTIC: "stable", STABLE: "stable",
    ASYMPTOTIC_UP_TO: "marginal", STABLE_UP_TO: "marginal", MARGINAL: "marginal",
    UNSTABLE: "unstable",
}  # fmt: skip
"""Styles of verdicts; any other answers leave the question open."""


def _style(word: str) -> Style:
    return _STYLES.get(word, "undecided")


_OF_WORDS: dict[Style, Style | None] = {"stable": "good", "marginal": None, "unstable": "bad", "undecided": "open"}
"""The style of a verdict within a text."""


def verdict_badge(word: str, more: str = "") -> Text:
    """Return a verdict on a line of its own: its symbol and its word, and what is said of it."""
    return styled(f"{SYMBOLS[_style(word)]} Verdict: {word}{more}", _style(word))


def word_style(word: str) -> Style | None:
    """Return the style of a verdict within a text or a table."""
    return _OF_WORDS[_style(word)]


def with_verdict(line: str, word: str, more: str = "") -> Text:
    """Return a line with a verdict at its end, and what is said of it."""
    return joined([line, styled(word + more, word_style(word))], "")


def grounds_lines(judged: Verdict) -> list[str]:
    """Return what a verdict rests on, and where the eigenvalues lie, in sentences."""
    lines: list[str] = [styled(f"Why {judged.word}:", "title")] if judged.reasons else []
    for reason in judged.reasons:
        lines += wrap_lines(reason, "  ", "  ")
    for sentence in () if judged.spectrum is None else judged.spectrum.sentences():
        lines += wrap_lines(sentence, "", "  ")
    if judged.if_symmetric is not None:
        lines += wrap_lines(str(judged.if_symmetric), "", "  ")
    return lines
