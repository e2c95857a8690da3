"""The pages of the manual: Markdown files of the package, and two that are made from the program itself."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import click

from mbstab.errors import UsageError, suggestion
from mbstab.report import WIDTH

FOLDER = Path(__file__).resolve().parents[2] / "manual"

WRITTEN = (
    "tutorial", "cheat-sheet", "how-to", "reading-the-output", "verdicts", "why-undecided", "model-file", "python",
    "coming-from", "theory", "limits", "examples", "teaching", "digits", "glossary", "inside", "changed-numbers",
    "citing",
)  # fmt: skip
"""Pages that are files, in the order in which they are best read."""

MADE = {"commands": "Every command and its options", "keys": "Every key of a model file"}
"""Pages that say what the program itself knows, with their titles."""

TOPICS = (*WRITTEN, *MADE)

LONG = 12
"""Pages with more headings than this begin with an index."""

INDEX = "On this page:"
"""Begins an index."""


def page(topic: str, group: click.Group) -> str:
    """Return a page as Markdown.

    Parameters
    ----------
    topic : str
        One of `TOPICS`.
    group : click.Group
        The commands of the program.

    Raises
    ------
    UsageError
        If there is no such topic.
    """
    from mbstab.cli.handbook.reference import commands_page, keys_page

    if topic in WRITTEN:
        return (FOLDER / f"{topic}.md").read_text(encoding="utf-8")
    if topic == "commands":
        return commands_page(MADE[topic], group)
    if topic == "keys":
        return keys_page(MADE[topic])
    hint = suggestion(topic, TOPICS) or f"mbstab manual lists the topics; mbstab manual --search {topic} looks inside"
    raise UsageError(f"there is no topic {topic!r}\nhint: {hint}")


def indexed(text: str) -> str:
    """Return a page with an index of its headings below its title, if they are many."""
    heads = [head.replace("`", "") for head in re.findall(r"^## (.*)$", text, flags=re.M)]
    if len(heads) <= LONG:
        return text
    index = textwrap.fill(f"{INDEX} {' · '.join(heads)}", WIDTH, break_on_hyphens=False, break_long_words=False)
    title, _, rest = text.partition("\n")
    return f"{title}\n\n{index}\n{rest}"


def titles() -> dict[str, str]:
    """Return the title of each topic."""
    found = {}
    for topic in WRITTEN:
        with (FOLDER / f"{topic}.md").open(encoding="utf-8") as file:
            found[topic] = file.readline().removeprefix("# ").rstrip()
    return found | MADE
