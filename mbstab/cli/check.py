"""``mbstab check``: is the file right, what does the scene consist of, what does it not need."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import (
    file_argument,
    format_option,
    load_model,
    output_option,
    parse_settings,
    set_option,
    warn,
    write,
)


@click.command()
@file_argument
@set_option
@format_option("table", "json")
@output_option
def check(file: str, settings: tuple[str, ...], format_: str, output: Path | None) -> None:
    """Say what the scene consists of, its degrees of freedom, and what it does not need.

    Example: mbstab check four_bar.yaml
    """
    mechanism = load_model(file)
    report = mechanism.check(**parse_settings(settings))
    warn(report.warnings)
    if format_ == "json":
        from mbstab.report.export import check_data, to_json

        write(to_json(check_data(report, mechanism.model.name, mechanism.model.title)), output, mechanism.model.name)
    else:
        from mbstab.report.tables import check_text

        write(check_text(report, mechanism.model.title), output, mechanism.model.name)
