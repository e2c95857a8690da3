"""``mbstab eig``: eigenvalues and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

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
from mbstab.errors import ExpectationError, NumericalError, UsageError
from mbstab.model.words import REQUIRED

if TYPE_CHECKING:
    from mbstab.api import Mechanism

CERTIFIED_DIGITS = 50


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
@click.option(
    "--precision",
    type=int,
    metavar="DIGITS",
    help="Compute so many right digits, 16 to 1000; parameters count with all decimals. Of the balls with --certify.",
)
@click.option(
    "--certify",
    is_flag=True,
    help="Enclose all eigenvalues with proven radii; a parameter may be an interval, such as omega=[5.6,10].",
)
@click.option(
    "--verify",
    is_flag=True,
    help="Excite each mode of the nonlinear motion a little; set its growth rate and frequency beside the eigenvalue. "
    "Exit with 3 if it contradicts.",
)
@click.option(
    "--require",
    type=click.Choice(tuple(REQUIRED)),
    help="Exit with 3 unless at least this stable, if only up to symmetry: position, heading, speed. "
    "marginal: at least no disturbance grows in the linearized equations.",
)
@format_option("table", "json", "csv")
@output_option
def eig(
    file: str,
    settings: tuple[str, ...],
    method: str,
    frozen: bool,
    precision: int | None,
    certify: bool,
    verify: bool,
    require: str | None,
    format_: str,
    output: Path | None,
) -> None:
    """Compute the eigenvalues of the linearized motion, with error bounds and a verdict.

    Example: mbstab eig pendulum.yaml --set L=0.5
    """
    parameters = parse_settings(settings)
    if (precision is not None or certify) and method != DEFAULT:
        message = f"--precision and --certify compute by deflation, not with --method {method}"
        raise UsageError(f"{message}\nhint: leave out one of them")
    if verify and (precision is not None or certify or method != DEFAULT or format_ == "csv"):
        raise UsageError("--verify goes with none of --precision, --certify, --method and --format csv")
    mechanism = load_model(file)
    if certify:
        if frozen or format_ == "csv":
            raise UsageError("--certify goes with neither --frozen nor --format csv")
        _certify(mechanism, parameters, precision or CERTIFIED_DIGITS, require, format_, output)
        return
    if wide := [name for name, text in parameters.items() if text.startswith("[")]:
        raise UsageError(f"{wide[0]} is an interval\nhint: intervals need --certify")
    if precision is not None:
        _precise(mechanism, parameters, frozen, precision, require, format_, output)
        return
    if verify:
        _verify(mechanism, parameters, frozen, require, format_, output)
        return
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
    _demand(require, result.verdict, result.reasons)


def _demand(require: str | None, verdict: str, reasons: Sequence[str]) -> None:
    """Refuse a verdict that is less than required."""
    if require and verdict not in REQUIRED[require]:
        raise ExpectationError(f"required: {require}, found: {verdict}: {'; '.join(reasons)}")


def _precise(
    mechanism: Mechanism,
    parameters: dict[str, str],
    frozen: bool,
    digits: int,
    require: str | None,
    format_: str,
    output: Path | None,
) -> None:
    """Answer with many digits."""
    with progress_bar("more digits") as progress:
        result = mechanism.eig_precise(digits, frozen, progress, **parameters)
    warn(result.warnings)
    if format_ == "csv":
        from mbstab.report.export import precise_csv

        text = precise_csv(result)
    elif format_ == "json":
        from mbstab.report.export import precise_data, to_json

        model = mechanism.model
        text = to_json(precise_data(result, model.name, model.title, mechanism.parameters(**parameters)))
    else:
        from mbstab.report.tables import precise_text

        text = precise_text(result, mechanism.model.title)
    write(text, output, mechanism.model.name)
    _demand(require, result.verdict, result.reasons)


def _verify(
    mechanism: Mechanism,
    parameters: dict[str, str],
    frozen: bool,
    require: str | None,
    format_: str,
    output: Path | None,
) -> None:
    """Write the eigenvalues, and what the nonlinear motion says about them; the exit code is 3 if it contradicts."""
    from mbstab.report.verification import verification_data, verification_text

    with progress_bar("exciting modes") as progress:
        found = mechanism.verify(frozen, progress, **parameters)
    model = mechanism.model
    warn(found.result.warnings)
    if format_ == "json":
        from mbstab.report.export import eigen_data, to_json

        data = eigen_data(found.result, model.name, model.title, mechanism.parameters(**parameters))
        text = to_json({**data, "verification": verification_data(found)})
    else:
        from mbstab.report.tables import eigen_text

        text = f"{eigen_text(found.result, model.title)}\n{verification_text(found)}"
    write(text, output, model.name)
    if found.verdict == "contradicted":
        raise ExpectationError(f"the nonlinear motion contradicts the eigenvalues: {found.reason}")
    _demand(require, found.result.verdict, found.result.reasons)


def _certify(
    mechanism: Mechanism,
    parameters: dict[str, str],
    digits: int,
    require: str | None,
    format_: str,
    output: Path | None,
) -> None:
    """Write enclosures and the verdict, proven or under conditions; without one the exit code is 1."""
    from mbstab.report.certificate import certificate_data, certificate_text

    with progress_bar("dividing the interval") as progress:
        result = mechanism.certify(digits, progress, **parameters)
    if format_ == "json":
        from mbstab.report.export import to_json

        text = to_json(certificate_data(result, mechanism.model.name, mechanism.model.title))
    else:
        text = certificate_text(result, mechanism.model.title)
    write(text, output, mechanism.model.name)
    if not result.decided:
        raise NumericalError(result.statement)
    _demand(require, result.verdict, [result.statement])
