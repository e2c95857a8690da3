"""``mbstab compare``: what each method keeps and costs at a model."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import (
    file_argument,
    format_option,
    load_model,
    output_option,
    parse_settings,
    progress_bar,
    save_picture,
    set_option,
    warn,
    write,
)
from mbstab.errors import UsageError


@click.command()
@file_argument
@set_option
@click.option(
    "--digits", type=click.IntRange(20, 1000), default=50, show_default=True, help="Digits of the truth compared with."
)
@click.option("--tol", "tolerance", type=float, help="Choose the fastest method with at most this relative error.")
@click.option(
    "--plot",
    "picture",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Draw error against time, one point for each method, to a file (.png, .svg or .pdf).",
)
@format_option("table", "json", "csv")
@output_option
def compare(
    file: str,
    settings: tuple[str, ...],
    digits: int,
    tolerance: float | None,
    picture: Path | None,
    format_: str,
    output: Path | None,
) -> None:
    """Compare all methods: error of each eigenvalue against many digits, claimed bounds, time, memory.

    The truth is the same model with as many digits as asked for, its parameters the exact decimals of the file.

    Example: mbstab compare governor.yaml --tol 1e-10
    """
    mechanism = load_model(file)
    model = mechanism.model
    if picture is not None:
        _check_picture(picture)
    with progress_bar("comparing") as progress:
        result = mechanism.compare(digits, tolerance, progress, **parse_settings(settings))
    warn(result.truth.warnings)
    if format_ == "json":
        from mbstab.report.export import compare_data, to_json

        write(to_json(compare_data(result, model.name, model.title)), output, model.name)
    elif format_ == "csv":
        from mbstab.report.export import compare_csv

        write(compare_csv(result), output, model.name)
    else:
        from mbstab.report.tables import compare_text

        write(compare_text(result, model.title), output, model.name)
    if picture is not None:
        from mbstab.report import plots

        save_picture(plots.work_precision(result, model.title), picture)


def _check_picture(path: Path) -> None:
    """Refuse a place for the picture before anything is computed."""
    from mbstab.report import plots

    if path.suffix[1:].lower() not in plots.FORMATS:
        raise UsageError(f"--plot {path}: pictures end with {', '.join('.' + name for name in plots.FORMATS)}")
    if not path.resolve().parent.is_dir():
        raise UsageError(f"{path}: cannot be written: there is no directory {path.parent}")
