"""``mbstab schema``: the JSON Schema of model files."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import output_option, write


@click.command()
@output_option
def schema(output: Path | None) -> None:
    """Print the JSON Schema with which editors complete and check model files.

    Example: mbstab schema -o mbstab.schema.json
    """
    from mbstab.model.schema import json_schema
    from mbstab.report.export import to_json

    write(to_json(json_schema()), output)
