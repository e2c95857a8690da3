"""Answers as the text that the commands print."""

from __future__ import annotations

from functools import partial
from typing import Any, TypeVar

from mbstab.model.schema import Model
from mbstab.records import Answer

T = TypeVar("T")


def printed(answer: T, model: Model) -> T:
    """Return an answer about a model, or several, which then print as that of the command does."""
    for one in answer if isinstance(answer, list) else [answer]:
        if isinstance(one, Answer):
            one.__dict__.setdefault("_text", partial(text_of, model))
    return answer


def text_of(model: Model, answer: Any) -> str:
    """Return the text of an answer about a model."""
    from mbstab.report.answers import content

    several = type(answer).__name__ == "Equilibrium"
    return str(content([answer] if several else answer, model, "table")).rstrip("\n")
