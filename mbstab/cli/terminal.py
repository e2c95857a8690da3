"""What a terminal gets beside the text: colours and links, and whether they are wanted."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Literal, get_args

from mbstab.errors import visible
from mbstab.report.styles import Style, Text

When = Literal["auto", "always", "never"]

COLOURS: tuple[When, ...] = get_args(When)

WHEN: ContextVar[When] = ContextVar("colours", default="auto")
"""When there are colours; auto: on a terminal."""


@contextlib.contextmanager
def without_colours() -> Iterator[None]:
    """Write no colours within, whatever is asked for."""
    before = WHEN.set("never")
    try:
        yield
    finally:
        WHEN.reset(before)


LOOKS: dict[Style, str] = {
    "stable": "black on green", "marginal": "black on yellow", "unstable": "bright_white on red",
    "undecided": "black on cyan",
    "grows": "bold red", "open": "magenta", "faint": "dim",
    "good": "green", "bad": "red", "title": "bold",
    "error": "bold red", "warning": "bold magenta", "hint": "bold cyan", "place": "bold", "file": "underline",
}  # fmt: skip
"""The look of each style, in the colours that every terminal sets for its own background."""


def is_coloured(stream: Any, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a stream gets colours: as ``--color`` says, NO_COLOR, FORCE_COLOR, or if it is a terminal with colours.

    NO_COLOR and FORCE_COLOR count where they are not empty, the first one more; FORCE_COLOR=0 does not count.
    """
    if WHEN.get() != "auto":
        return WHEN.get() == "always"
    if environment.get("NO_COLOR"):
        return False
    if environment.get("FORCE_COLOR", "0") not in ("", "0"):
        return True
    return draws(stream, environment)


def draws(stream: Any, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether a stream is a terminal that can do more than write line by line."""
    return bool(stream.isatty()) and environment.get("TERM", "").lower() not in ("dumb", "unknown")


def painted(text: str) -> str:
    """Return a text in the looks of its styles; what cannot be seen is made visible first."""
    from rich.color import ColorSystem
    from rich.style import Style as Look

    parts, at = [], 0
    for first, stop, style in getattr(text, "spans", ()):
        look = Look.parse(LOOKS[style])
        if style == "file":
            look += Look(link=Path(text[first:stop]).absolute().as_uri())
        parts += [visible(text[at:first]), look.render(visible(text[first:stop]), color_system=ColorSystem.STANDARD)]
        at = stop
    return "".join([*parts, visible(text[at:])])


def shown(text: str, stream: Any) -> str:
    """Return a text as a stream gets it: with colours where they are wanted, and nothing that cannot be seen."""
    return painted(text) if isinstance(text, Text) and is_coloured(stream) else visible(text)
