"""``mbstab response``: from inputs to outputs over frequency and over time."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import file_argument, force_option, listed, load_model, set_option
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

PICTURES = ("bode", "nyquist", "step", "impulse")


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
@click.option(
    "--plot",
    "pictures",
    callback=listed(click.Choice(PICTURES)),
    metavar="[" + "|".join(PICTURES) + "]",
    multiple=True,
    help="Pictures to draw, separated by commas or repeated: bode or nyquist; step or impulse with these options.",
)
@pictures_option
@output_options("table", "json", "csv", unnamed="outputs of the model are chosen by --measured")
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
    pictures: tuple[str, ...],
    place: Path | None,
    output: Output,
) -> None:
    """Compute frequency responses from the inputs: to the outputs: of the file with zeros, margins and largest gains.

    Zeros have error estimates; a transfer function is called minimum phase, or not, only where these decide it.
    Margins are those of the loop in which the output is subtracted from the input.
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
    possible = ("bode", "nyquist") if duration is None else ("impulse",) if step is None else ("step",)
    if wrong := [x for x in pictures if x not in possible]:
        raise UsageError(f"--plot {wrong[0]}: this response is drawn as {' or '.join(possible)}")
    wanted = pictures or possible[:1] * (place is not None)
    paths = picture_paths(*picture_stem(place, output.path, Path(model.name)), wanted)
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
    if paths:
        from mbstab.report.pictures.responses import nyquist, response_picture

        for name, path in paths.items():
            save_picture((nyquist if name == "nyquist" else response_picture)(result, model.title), path)
