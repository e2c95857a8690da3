"""``mbstab sweep``: eigenvalues over a parameter, and where stability changes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mbstab.cli.common import (
    file_argument,
    load_model,
    note,
    output_option,
    parse_settings,
    progress_bar,
    set_option,
    show,
    write,
)
from mbstab.errors import NumericalError, UsageError

if TYPE_CHECKING:
    from mbstab.analysis.sweep import Sweep

FORMATS = ("table", "json", "csv", "npz")
PICTURES = ("map", "locus", "campbell", "none")
SUFFIXES = (".png", ".svg", ".pdf")


@click.command()
@file_argument
@click.option("--param", "parameters", metavar="NAME", multiple=True, required=True, help="Parameter to sweep.")
@click.option("--from", "start", metavar="VALUE", help="First value, in the parameter's unit or an expression.")
@click.option("--to", "stop", metavar="VALUE", help="Last value.")
@click.option("--points", type=click.IntRange(2, 10_000_000), help="Number of values.")
@click.option("--log", "logarithmic", is_flag=True, help="Space the values logarithmically.")
@click.option("--values", metavar="LIST", help="The values themselves, separated by commas.")
@set_option
@click.option(
    "--plot",
    "pictures",
    type=click.Choice(PICTURES),
    multiple=True,
    help="Pictures to draw; map and locus if not given, none for none.",
)
@click.option(
    "--pictures",
    "place",
    type=click.Path(path_type=Path),
    help="How the names of the pictures begin, with the suffix .png, .svg or .pdf; else beside the model or --output.",
)
@click.option("--resume", is_flag=True, help="Go on with a sweep to --output that was interrupted.")
@click.option("--jobs", type=click.IntRange(1, 1024), default=1, show_default=True, help="Number of processes.")
@click.option("--cluster", metavar="ADDRESS", default="", help="Compute on a Dask cluster, tcp://HOST:PORT.")
@click.option("--format", "format_", type=click.Choice(FORMATS), help="Of the data; told by the suffix of --output.")
@output_option
def sweep(
    file: str,
    parameters: tuple[str, ...],
    start: str | None,
    stop: str | None,
    points: int | None,
    logarithmic: bool,
    values: str | None,
    settings: tuple[str, ...],
    pictures: tuple[str, ...],
    place: Path | None,
    resume: bool,
    jobs: int,
    cluster: str,
    format_: str | None,
    output: Path | None,
) -> None:
    """Follow the eigenvalues over a parameter and find the values at which stability changes.

    The range is that of the file's sweep: block unless given. The terminal shows the critical values; all branches go
    to --output as CSV, JSON or npz, and pictures beside it.

    Example: mbstab sweep top.yaml --param omega --from 0 --to 12 -o top.csv
    """
    from mbstab.model.ranges import sweep_values

    if len(parameters) > 1:
        raise UsageError("a sweep follows one parameter; give --param once")
    (parameter,) = parameters
    format_ = format_ or _format_of(output)
    if format_ == "npz" and output is None:
        raise UsageError("--format npz needs --output")
    if resume and output is None:
        raise UsageError("--resume goes with --output, beside which the finished parts are kept")
    mechanism = load_model(file)
    model = mechanism.model
    grid = sweep_values(model, parameter, start, stop, points, logarithmic, values)
    directory = output.with_name(output.name + ".parts") if output is not None else None
    with progress_bar("sweeping") as progress:
        result = mechanism.sweep(
            parameter,
            grid,
            progress=progress,
            directory=directory,
            resume=resume,
            jobs=jobs,
            cluster=cluster,
            **parse_settings(settings),
        )
    unit, factor = model.parameters[parameter].unit, model.parameters[parameter].factor
    if format_ == "table":
        from mbstab.report.tables import sweep_text

        write(sweep_text(result, unit, factor, model.title), output, model.name)
    else:
        from mbstab.report import export

        if format_ == "json":
            write(export.to_json(export.sweep_data(result, unit, factor, model.name, model.title)), output, model.name)
        elif format_ == "csv":
            write(export.sweep_csv(result, factor), output, model.name)
        else:
            write(export.npz_bytes(export.sweep_arrays(result, factor)), output, model.name)
        if output is not None:
            from mbstab.report.tables import sweep_text

            show(sweep_text(result, unit, factor, model.title))
    if not pictures and (format_ == "table" or output is not None):
        pictures = ("map", "locus")
    if pictures and "none" not in pictures:
        _draw(
            result, pictures, *_stem(place, output, Path(model.name), parameter), _label(parameter, unit), model.title
        )
    if result.problems:
        count = len(result.problems)
        raise NumericalError(f"{count} of {len(result.values)} points have no answer; the others are computed")


def _draw(result: Sweep, pictures: tuple[str, ...], stem: Path, suffix: str, label: str, title: str) -> None:
    """Draw pictures of a sweep to files whose names begin alike."""
    from mbstab.report import plots

    kinds = {"map": plots.stability_map, "locus": plots.root_locus, "campbell": plots.campbell}
    for picture in pictures:
        path = stem.with_name(f"{stem.name}-{picture}{suffix}")
        plots.save(kinds[picture](result, label, title), path)
        note(f"wrote {path}")


def _stem(place: Path | None, output: Path | None, model: Path, parameter: str) -> tuple[Path, str]:
    """Return how the names of the pictures begin, and their suffix."""
    from mbstab.model.library import installed_models

    if place is not None:
        suffix = place.suffix if place.suffix in SUFFIXES else SUFFIXES[0]
        return (place.with_suffix("") if place.suffix in SUFFIXES else place), suffix
    if output is not None:
        return output.with_suffix(""), SUFFIXES[0]
    name = f"{model.stem}-{parameter}"
    return (Path(name) if model in installed_models() else model.with_name(name)), SUFFIXES[0]


def _label(parameter: str, unit: str) -> str:
    return f"{parameter} ({unit})" if unit else parameter


def _format_of(output: Path | None) -> str:
    suffix = "" if output is None else output.suffix.lstrip(".")
    return suffix if suffix in FORMATS else "table" if output is None else "csv"
