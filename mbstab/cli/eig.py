"""``mbstab eig``: eigenvalues and verdict."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

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

if TYPE_CHECKING:
    from mbstab.api import Mechanism

METHODS = ("nullspace", "index3", "paper")
REQUIRED = {
    "stable": ("asymptotically stable",),
    "marginal": ("asymptotically stable", "marginally stable"),
}


@click.command()
@file_argument
@set_option
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="nullspace deflates constraints and zeros; index3 is QZ on the regular pencil, paper QZ on Eq. (70).",
)
@click.option(
    "--frozen",
    is_flag=True,
    help="Take the equations as they are at the reference time; for comparison, no stability verdict.",
)
@click.option(
    "--certify",
    is_flag=True,
    help="Enclose all eigenvalues with proven radii; a parameter may be an interval, such as omega=[5.6,10].",
)
@click.option("--digits", type=int, default=50, show_default=True, help="Decimal digits with --certify.")
@click.option("--require", type=click.Choice(tuple(REQUIRED)), help="Exit with 3 unless at least this stable.")
@format_option("table", "json", "csv")
@output_option
def eig(
    file: str,
    settings: tuple[str, ...],
    method: str,
    frozen: bool,
    certify: bool,
    digits: int,
    require: str | None,
    format_: str,
    output: Path | None,
) -> None:
    """Compute the eigenvalues of the linearized motion, with error bounds and a verdict.

    Example: mbstab eig pendulum.yaml --set L=0.5
    """
    from mbstab.errors import ExpectationError, UsageError

    parameters = parse_settings(settings)
    mechanism = load_model(file)
    if certify:
        if frozen or method != METHODS[0] or format_ == "csv":
            raise UsageError("--certify goes with neither --method nor --frozen nor --format csv")
        _certify(mechanism, parameters, digits, require, format_, output)
        return
    if wide := [name for name, text in parameters.items() if text.startswith("[")]:
        raise UsageError(f"{wide[0]} is an interval\nhint: intervals need --certify")
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


def _certify(
    mechanism: Mechanism,
    parameters: dict[str, str],
    digits: int,
    require: str | None,
    format_: str,
    output: Path | None,
) -> None:
    """Write enclosures and the proven verdict; without one the exit code is 1."""
    from mbstab.errors import ExpectationError, NumericalError
    from mbstab.report.certificate import certificate_data, certificate_text

    with progress_bar("dividing the interval") as progress:
        result = mechanism.certify(digits, progress, **parameters)
    if format_ == "json":
        from mbstab.report.export import to_json

        text = to_json(certificate_data(result, mechanism.model.name, mechanism.model.title))
    else:
        text = certificate_text(result, mechanism.model.title)
    write(text, output, mechanism.model.name)
    if not result.proven:
        raise NumericalError(result.statement)
    if require and result.verdict not in REQUIRED[require]:
        raise ExpectationError(f"required: {require}, found: {result.verdict}")
