"""``mbstab models``: the example models."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import model_argument
from mbstab.cli.output import Output, output_options, save, show, write_bytes
from mbstab.errors import UsageError


@click.group(invoke_without_command=True)
@click.pass_context
def models(context: click.Context) -> None:
    """List, show and copy the example models.

    Without a command, list them.
    """
    if context.invoked_subcommand is None:
        context.invoke(list_models, format_=None, output=None)


@models.command(name="list")
@output_options("table", "json", "csv")
def list_models(output: Output) -> None:
    """Print names and titles of the example models."""
    from mbstab.model.library import installed_models
    from mbstab.model.reader import read_model
    from mbstab.report.export import to_csv, to_json
    from mbstab.report.tables import table

    heads = ["model", "title"]
    rows = [[path.name, read_model(path).title] for path in installed_models()]
    output.write(
        {
            "table": lambda: table(heads, rows, left=(0, 1)),
            "json": lambda: to_json([dict(zip(heads, row, strict=True)) for row in rows]),
            "csv": lambda: to_csv(heads, rows),
        }
    )


@models.command(name="show")
@model_argument("name")
def show_model(name: str) -> None:
    """Print a model file."""
    from mbstab.model.yamlfile import decoded

    source, content = _content(name)
    show(decoded(content, str(source)))


@models.command()
@model_argument("name")
@click.argument("target", type=click.Path(path_type=Path), default=Path("."))
def copy(name: str, target: Path) -> None:
    """Copy a model file here, or to TARGET; an existing file is not overwritten."""
    source, content = _content(name)
    goal = target / source.name if target.is_dir() else target
    if goal.exists():
        raise UsageError(f"{goal} exists already\nhint: name another TARGET")
    save(goal, lambda path: write_bytes(path, content), "TARGET")


def _content(name: str) -> tuple[Path, bytes]:
    """Return a model file and its content."""
    from mbstab.model.library import find_model
    from mbstab.model.yamlfile import read_text

    path = find_model(name).path
    return path, read_text(path)
