"""``mbstab models``: the example models."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import note, write
from mbstab.errors import UsageError


@click.group()
def models() -> None:
    """List, show and copy the example models."""


@models.command(name="list")
def list_models() -> None:
    """Print names and titles of the example models."""
    from mbstab.model.library import installed_models
    from mbstab.model.reader import read_model
    from mbstab.report.tables import table

    rows = [[path.name, read_model(path).title] for path in installed_models()]
    write(table(["model", "title"], rows, left=(0, 1)), None)


@models.command()
@click.argument("name")
def show(name: str) -> None:
    """Print a model file."""
    from mbstab.model.library import find_model

    write(find_model(name).path.read_text(encoding="utf-8"), None)


@models.command()
@click.argument("name")
@click.argument("target", type=click.Path(path_type=Path), default=Path("."))
def copy(name: str, target: Path) -> None:
    """Copy a model file here, or to TARGET; an existing file is not overwritten."""
    import shutil

    from mbstab.model.library import find_model

    source = find_model(name).path
    goal = target / source.name if target.is_dir() else target
    if goal.exists():
        raise UsageError(f"{goal} exists already")
    try:
        shutil.copyfile(source, goal)
    except OSError as error:
        raise UsageError(f"{goal}: cannot be written: {error.strerror}") from None
    note(f"wrote {goal}")
