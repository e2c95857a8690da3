"""``mbstab compare``: accuracy and cost of each method for a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mbstab.cli.common import load_model, model_command, parse_settings, plot_option, progress_bar, refuse_given
from mbstab.cli.output import Output, output_options, picture_paths, picture_stem, save_picture, warn

if TYPE_CHECKING:
    from mbstab.api import Mechanism


@model_command
@click.option(
    "--digits", type=click.IntRange(20, 1000), default=50, show_default=True, help="Digits of the truth compared with."
)
@click.option("--tol", "tolerance", type=float, help="Choose the fastest method with at most this relative error.")
@click.option(
    "--simulate", is_flag=True, help="Compare the integrators of mbstab simulate on the nonlinear motion instead."
)
@click.option("--to", type=float, metavar="T", help="With --simulate: last time (s); 1 s after the start if not given.")
@click.option(
    "--perturb",
    "disturbances",
    metavar="NAME=VALUE",
    multiple=True,
    help="With --simulate: add to the reference motion, as mbstab simulate does; mode:1=0.1 if nothing is given.",
)
@plot_option("error", meaning="error: that of each method against its time")
@output_options("table", "json", "csv")
def compare(
    file: str,
    settings: tuple[str, ...],
    digits: int,
    tolerance: float | None,
    simulate: bool,
    to: float | None,
    disturbances: tuple[str, ...],
    pictures: tuple[str, ...],
    place: Path | None,
    output: Output,
) -> None:
    """Compare methods or integrators: errors, bounds, time.

    The truth is the same model with as many digits as asked for, its parameters the exact decimals of the file. With
    --simulate: error, time, evaluations and drift of all integrators with several tolerances.

    Example: mbstab compare governor.yaml --tol 1e-10
    """
    if simulate:
        refuse_given(("digits",), "with --simulate")
    else:
        refuse_given(("to", "disturbances"), "without --simulate")
    mechanism = load_model(file, settings)
    model = mechanism.model
    paths = picture_paths(*picture_stem(place, output.path, Path(model.name)), pictures)
    if simulate:
        _integrators(mechanism, to, disturbances, tolerance, paths, output)
        return
    with progress_bar("comparing") as progress:
        result = mechanism.compare(digits, tolerance, progress)
    warn(result.truth.warnings)
    output.answer(result, model)
    for path in paths.values():
        from mbstab.report.pictures.work_precision import work_precision

        save_picture(lambda: work_precision(result, model.title), path)


def _integrators(
    mechanism: Mechanism,
    to: float | None,
    disturbances: tuple[str, ...],
    tolerance: float | None,
    paths: dict[str, Path],
    output: Output,
) -> None:
    """Compare the integrators on the nonlinear motion."""
    model = mechanism.model
    perturb = parse_settings(disturbances, "--perturb")
    with progress_bar("comparing") as progress:
        result = mechanism.compare_integrators(to, perturb, tolerance, progress)
    output.answer(result, model)
    for path in paths.values():
        from mbstab.report.pictures.work_precision import integrator_precision

        save_picture(lambda: integrator_precision(result, model.title), path)
