"""Errors as text for people: where, what, the line of the file with a caret, and a hint."""

from __future__ import annotations

from mbstab.errors import MbstabError, ModelFileError, SeveralErrors
from mbstab.report.styles import Style, Text, joined, styled


def error_text(error: MbstabError) -> Text:
    """Return an error: what is wrong in a file begins with its place, any other with ``error:``."""
    if isinstance(error, SeveralErrors):
        return joined(map(error_text, error.errors), "\n\n")
    if isinstance(error, ModelFileError):
        return joined((joined((styled(x, _LOOKS[kind]) for kind, x in own), "") for own in error.parts()), "\n\n")
    return message_text("error", str(error))


def message_text(kind: Style, text: str) -> Text:
    """Return a message that begins with its kind, as ``warning:``; its hints begin lines with ``hint:``."""
    message, *hints = text.split("\nhint: ")
    parts = [styled(f"{kind}:", kind), f" {message}"]
    for hint in hints:
        parts += ["\n", styled("hint:", "hint"), f" {hint}"]
    return joined(parts, "")


_LOOKS: dict[str, Style | None] = {"place": "place", "text": None, "source": None, "caret": "error", "hint": "hint"}
