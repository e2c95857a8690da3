"""Pages that say what the program itself knows: commands and options, sections of model files and keys."""

from __future__ import annotations

import inspect
import re
import textwrap

import click

from mbstab.report import WIDTH


def commands_page(title: str, group: click.Group) -> str:
    """Return all commands and their options as Markdown."""
    parts = [f"# {title}\n\n{_paragraphs(group.help)}\n"]
    parts += _commands(group, click.Context(group, info_name="mbstab"))
    return "\n".join(parts)


def _commands(group: click.Group, context: click.Context) -> list[str]:
    found = []
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        inside = click.Context(command, info_name=name, parent=context)
        if isinstance(command, click.Group):
            found += _commands(command, inside)
        else:
            found.append(_command(command, inside))
    return found


def _command(command: click.Command, context: click.Context) -> str:
    usage = _filled(" ".join([context.command_path, *command.collect_usage_pieces(context)]), "  ")
    lines = [f"## `{context.command_path}`\n", f"```text\n{usage}\n```\n", _paragraphs(command.help), ""]
    for parameter in command.params:
        record = parameter.get_help_record(context)
        if record is not None and record[1]:
            lines.append(_filled(f"* `{record[0]}`: {record[1]}", "  "))
    return "\n".join(lines) + "\n"


def _paragraphs(text: str | None) -> str:
    """Return a docstring as Markdown: an example is set as what is typed."""
    blocks = inspect.cleandoc(text or "").split("\n\n")
    return "\n\n".join(_filled(re.sub(r"^Example: (.*)$", r"Example: `\1`", block, flags=re.S)) for block in blocks)


def _filled(text: str, indent: str = "") -> str:
    """Return a paragraph in lines of 80 columns."""
    words = " ".join(text.split())
    return textwrap.fill(words, WIDTH, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)


def keys_page(title: str) -> str:
    """Return the sections of a model file and their keys as Markdown."""
    from mbstab.cli.commands.schema import section_text
    from mbstab.mechanics.elements import KINDS
    from mbstab.model.keys import EXPLAINED, SECTIONS

    parts = [
        f"# {title}\n",
        "What `mbstab schema SECTION` prints, section by section. A key that is not",
        "required may be left out.\n",
    ]
    explained = [*KINDS, *EXPLAINED]
    inner = {name: [x for x in explained if x == name or x.startswith(f"{name}.")] for name in SECTIONS}
    for name, known in SECTIONS.items():
        parts.append(f"## `{name}`\n\n{_filled(known.text[0].upper() + known.text[1:] + '.')}\n")
        parts += [_listing(section, section_text(section), section != name) for section in inner[name]]
    titles = {"shape": "Shapes of bodies", "measures": "What can be measured", "functions": "Functions of expressions"}
    for section, heading in titles.items():
        parts.append(f"## {heading}\n")
        parts.append(_listing(section, section_text(section), False))
    return "\n".join(parts)


def _listing(section: str, text: str, named: bool) -> str:
    lines = [line if len(line) <= WIDTH else _filled(line, "    ") for line in text.rstrip().splitlines()]
    return (f"Keys of `{section}`:\n\n" if named else "") + "```text\n" + "\n".join(lines) + "\n```\n"
