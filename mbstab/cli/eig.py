"""``mbstab eig``: eigenvalues and verdict."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.analysis.methods import DEFAULT, METHODS
from mbstab.cli.common import (
    file_argument,
    format_option,
    load_model,
    output_option,
    parse_settings,
    progress_bar,
    set_option,
    warn,
    write,
)

REQUIRED = {
    "stable": ("asymptotically stable",),
    "marginal": ("asymptotically stable", "marginally stable"),
}


@click.command()
@file_argument
@set_option
@click.option(
    "--method",
    type=click.Choice(tuple(METHODS)),
    default=DEFAULT,
    show_default=True,
    help="; ".join(f"{name}: {method.description}" for name, method in METHODS.items()) + ".",
)
@click.option(
    "--frozen",
    is_flag=True,
    help="Take the equations as they are at the reference time; for comparison, no stability verdict.",
)
@click.option("--require", type=click.Choice(tuple(REQUIRED)), help="Exit with 3 unless at least this stable.")
@format_option("table", "json", "csv")
@output_option
def eig(
    file: str,
    settings: tuple[str, ...],
    method: str,
    frozen: bool,
    require: str | None,
    format_: str,
    output: Path | None,
) -> None:
    """Compute the eigenvalues of the linearized motion, with error bounds and a verdict.

    Example: mbstab eig pendulum.yaml --set L=0.5
    """
    from mbstab.errors import ExpectationError

    parameters = parse_settings(settings)
    mechanism = load_model(file)
    with progress_bar("following the period") as progress:
        result = mechanism.eig(method, frozen, progress, **parameters)
    warn(result.warnings)
    if format_ == "csv":
        from mbstab.report.export import eigen_csv

        text = eigen_csv(result)
    elif format_ == "json":
        from mbstab.report.export import eigen_data, to_json

        text = to_json(
            eigen_data(result, mechanism.model.name, mechanism.model.title, mechanism.parameters(**parameters))
        )
    else:
        from mbstab.report.tables import eigen_text

        text = eigen_text(result, mechanism.model.title)
    write(text, output, mechanism.model.name)
    if require and result.verdict not in REQUIRED[require]:
        raise ExpectationError(f"required: {require}, found: {result.verdict}")
