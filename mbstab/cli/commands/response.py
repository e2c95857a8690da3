"""``mbstab response``: from inputs to outputs over frequency and over time."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import file_argument, force_option, load_model, set_option
from mbstab.cli.output import (
    Output,
    check_pictures,
    output_options,
    picture_paths,
    picture_stem,
    pictures_option,
    save_picture,
    warn,
)
from mbstab.errors import UsageError


@click.command()
@file_argument
@set_option
@force_option
@click.option("--input", "sources", multiple=True, metavar="NAME", help="From this input; may be repeated; else all.")
@click.option("--measured", "goals", multiple=True, metavar="NAME", help="To this output; may be repeated; else all.")
@click.option("--from", "start", type=float, metavar="OMEGA", help="First frequency (rad/s).")
@click.option("--to", "stop", type=float, metavar="OMEGA", help="Last frequency (rad/s).")
@click.option("--points", type=click.IntRange(2, 100_000), default=201, show_default=True, help="How many values.")
@click.option(
    "--step", type=float, metavar="T", help="The outputs for T seconds after a unit step of an input instead."
)
@click.option("--impulse", type=float, metavar="T", help="The same after a unit impulse.")
@click.option("--frozen", is_flag=True, help="Take the equations as they are at the reference time.")
@click.option("--plot", is_flag=True, help="Draw Bode diagrams, or what follows a step or an impulse.")
@pictures_option
@output_options("table", "json", "csv")
def response(
    file: str,
    settings: tuple[str, ...],
    sources: tuple[str, ...],
    goals: tuple[str, ...],
    start: float | None,
    stop: float | None,
    points: int,
    step: float | None,
    impulse: float | None,
    frozen: bool,
    plot: bool,
    place: Path | None,
    output: Output,
) -> None:
    """Compute frequency responses and zeros from the inputs: to the outputs: of the file, or step responses.

    Zeros have error estimates; a transfer function is called minimum phase, or not, only where these decide it.
    Frequencies are those of the eigenvalues and a decade beyond unless --from and --to say others.

    Example: mbstab response whipple_bicycle.yaml --input steer_torque
    """
    if step is not None and impulse is not None:
        raise UsageError("--step and --impulse exclude each other")
    duration = impulse if step is None else step
    if duration is not None and not 0.0 < duration < float("inf"):
        raise UsageError(f"a response over {duration:g} s: give a positive time")
    if duration is not None and (start is not None or stop is not None):
        raise UsageError("--from and --to are frequencies, which --step and --impulse do not have")
    check_pictures(place)
    mechanism = load_model(file, settings)
    model = mechanism.model
    name = "bode" if duration is None else "impulse" if step is None else "step"
    paths = {}
    if plot or place is not None:
        stem, suffix = picture_stem(place, output.path, Path(model.name))
        paths = picture_paths(stem, suffix, [name])
    from mbstab.analysis.linear.response import answer
    from mbstab.report import export, responses

    found = mechanism.state_space(frozen=frozen)
    warn(found.linear.motion.warnings)
    result = answer(found, sources, goals, (start, stop), points, duration, step is None)
    output.write(
        {
            "table": lambda: responses.response_text(result, model.title),
            "json": lambda: export.to_json(responses.response_data(result, model.name, model.title)),
            "csv": lambda: responses.response_csv(result),
        }
    )
    for path in paths.values():
        from mbstab.report.pictures.responses import response_picture

        save_picture(response_picture(result, model.title), path)
