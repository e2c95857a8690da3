"""``mbstab manual``: the manual, by topic, by search, or as a web site."""

from __future__ import annotations

import re
import sys
import textwrap
from pathlib import Path

import click
from click.shell_completion import CompletionItem

from mbstab.cli.common import progress_bar
from mbstab.cli.output import note, quiet_option, show, with_file
from mbstab.cli.terminal import is_coloured
from mbstab.errors import UsageError
from mbstab.report import WIDTH, set_width, width

SHOWN = 20
"""Places that a search shows."""


def _topics(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    from mbstab.cli.handbook.pages import TOPICS

    return [CompletionItem(topic) for topic in TOPICS if topic.startswith(incomplete)]


@click.command(context_settings={"ignore_unknown_options": True})  # an option may be searched for
@click.argument("words", metavar="[TOPIC]", nargs=-1, shell_complete=_topics)
@click.option("--search", is_flag=True, help="Show where the manual says something about the words given.")
@click.option(
    "--html",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="Write the manual as a web site that needs no network, with a page for each example model, or for the models "
    "named as TOPIC; some minutes for all.",
)
@quiet_option
def manual(words: tuple[str, ...], search: bool, folder: Path | None) -> None:
    """Show a page of the manual; without TOPIC, list the topics.

    Example: mbstab manual tutorial
    """
    from mbstab.cli.handbook import pages

    group = click.get_current_context().find_root().command
    assert isinstance(group, click.Group)
    if folder is not None:
        _write_site(folder, group, words, search)
    elif search:
        show(_answer({name: pages.page(name, group) for name in pages.TOPICS}, words))
    elif len(words) > 1:
        raise UsageError(f"one TOPIC at a time, not {' '.join(words)!r}\nhint: --search looks for words")
    elif words:
        _show_page(pages.indexed(pages.page(words[0], group)))
    else:
        width = max(map(len, pages.TOPICS)) + 2
        lines = "".join(f"  {name:{width}}{title}\n" for name, title in pages.titles().items())
        show(f"mbstab manual TOPIC shows a page, mbstab manual --search WORDS looks inside.\n\n{lines}")


def _write_site(folder: Path, group: click.Group, names: tuple[str, ...], search: bool) -> None:
    from mbstab.cli.handbook.site import write_site
    from mbstab.model.library import find_model, installed_models

    if search:
        raise UsageError("--search and --html exclude each other")
    set_width(WIDTH)  # of texts in the pages, whatever the terminal
    models = [find_model(name).path for name in names] or installed_models()
    with progress_bar("pages of models", len(models)) as progress:
        write_site(folder, group, models, progress)
    note(with_file("wrote", folder / "index.html"))


def _show_page(text: str) -> None:
    from mbstab.cli.handbook.terminal import plain, rendered

    coloured = is_coloured(sys.stdout)
    page = rendered(text) if coloured else plain(text)
    if sys.stdout.isatty():
        click.echo_via_pager(page, color=coloured)
    elif coloured:
        click.echo(page, nl=False, color=True)
    else:
        show(page)


def _answer(texts: dict[str, str], words: tuple[str, ...]) -> str:
    """Return where something is said, with the page and the heading."""
    from mbstab.cli.handbook.lookup import found_places, places

    found = found_places([place for topic, text in texts.items() for place in places(topic, text)], " ".join(words))
    lines = []
    for place in found[:SHOWN]:
        lines.append(f"{place.topic}: {place.heading.replace('`', '')}")
        short = textwrap.shorten(_without_lines(place.text), 4 * width(), placeholder=" …")
        lines += textwrap.wrap(short, width(), initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
    if len(found) > SHOWN:
        lines.append(f"and {len(found) - SHOWN} more places: add a word")
    return "\n".join(lines) + "\n"


def _without_lines(text: str) -> str:
    """Return a row of a table as "first cell: second cell; third cell", and other text as it is."""
    if not re.fullmatch(r"\|.*\|", text):
        return text
    first, *others = text.strip("| ").split(" | ")
    return f"{first}: {'; '.join(others)}"
