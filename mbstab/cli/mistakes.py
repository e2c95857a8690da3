"""Mistakes on the command line, told as all others: what is wrong, and a hint."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbstab.cli.terminal import COLOURS
from mbstab.errors import nearest, suggestion

FORMATS = ("table", "json", "csv", "npz", "md", "html")
"""What commands write; those who ask for --json are told how."""


if TYPE_CHECKING:
    _Choice = click.Choice[str]
else:
    _Choice = click.Choice  # generic from click 8.2 on


class Choice(_Choice):
    """One of some words; for another one the nearest of them is suggested."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the word.

        Raises
        ------
        click.BadParameter
            If it is none of them.
        """
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter:
            words = ", ".join(self.choices)
            near = suggestion(str(value), self.choices)
            text = f"{value!r} is none of {words}" + (f"\nhint: {near}" if near else "")
            raise click.BadParameter(text, ctx, param) from None


def call_error(error: click.ClickException) -> str:
    """Return what is wrong with a call, and a hint."""
    message, context = error.message, getattr(error, "ctx", None)
    path = context.command_path if context is not None else "mbstab"
    hint = f"{path} --help shows arguments and options"
    if isinstance(error, click.NoSuchOption):
        message, hint = f"{path} has no option {error.option_name}", _option_hint(error.option_name, context) or hint
    elif isinstance(error, click.MissingParameter):
        message = f"{_name(error.param)} is missing"
    elif isinstance(error, click.BadParameter):
        message = f"{_name(error.param)}: {message.rstrip('.')}"
    message, _, own = message.partition("\nhint: ")
    message = message.rstrip(".")
    return f"{message[:1].lower() if message[1:2].islower() else message[:1]}{message[1:]}\nhint: {own or hint}"


def _name(parameter: click.Parameter | None) -> str:
    """Return what a parameter is called on the command line."""
    if isinstance(parameter, click.Option):
        return max(parameter.opts, key=len)
    return "an argument" if parameter is None else parameter.human_readable_name


def _option_hint(name: str, context: click.Context | None) -> str:
    """Return what an unknown option may mean: a format, a file whose name begins with a dash, a known option."""
    if name == "--color":
        return f"--color {', '.join(COLOURS[:-1])} or {COLOURS[-1]}"
    if name.removeprefix("--") in FORMATS:
        return f"--format {name.removeprefix('--')}"
    for given in sys.argv[1:]:
        if given.startswith("-") and Path(given).is_file():
            return f"the file of that name is ./{given}"
    known = [x for own in (context.command.params if context is not None else ()) for x in own.opts]
    near = nearest(name, known)
    return f"did you mean {near}?" if near else ""
