"""``mbstab check``: whether the file is correct, what the scene consists of, and what it does not need."""

from __future__ import annotations

import click

from mbstab.cli.common import load_model, model_command
from mbstab.cli.output import Output, output_options, warn


@model_command
@click.option("--expanded", is_flag=True, help="Print the file with its repetitions and parts written out, and stop.")
@output_options("table", "json")
def check(file: str, settings: tuple[str, ...], expanded: bool, output: Output) -> None:
    """Say what the scene consists of and what it does not need.

    That is its bodies, its rows of constraints, its degrees of freedom and its symmetries.

    Example: mbstab check four_bar.yaml
    """
    mechanism = load_model(file, settings)
    if expanded:
        from mbstab.model.reader import expanded_text

        output.write({"table": lambda: expanded_text(mechanism.model)})
        return
    report, model = mechanism.check(), mechanism.model
    warn(report.warnings)
    output.answer(report, model)
