"""``mbstab response``: from inputs to outputs over frequency and over time."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mbstab.cli.common import load_model, model_command, parse_ranges, plot_option, progress_bar
from mbstab.cli.output import (
    Output,
    output_options,
    picture_paths,
    picture_stem,
    save_picture,
    warn,
)
from mbstab.errors import UsageError

if TYPE_CHECKING:
    from mbstab.analysis.response.response import Response
    from mbstab.api import Mechanism
    from mbstab.model.schema import Model

PICTURES = ("bode", "nyquist", "step", "impulse", "unbalance")


@model_command
@click.option("--input", "sources", multiple=True, metavar="NAME", help="From this input only; may be repeated.")
@click.option("--measured", "goals", multiple=True, metavar="NAME", help="To this output only; may be repeated.")
@click.option(
    "--from", "start", metavar="OMEGA", help="First frequency (rad/s); with --unbalance first spin, in its own unit."
)
@click.option("--to", "stop", metavar="OMEGA", help="Last frequency or spin.")
@click.option("--points", type=click.IntRange(2, 100_000), default=201, show_default=True, help="How many values.")
@click.option(
    "--step", type=float, metavar="T", help="Instead: the outputs for T seconds after a unit step of an input."
)
@click.option("--impulse", type=float, metavar="T", help="The same after a unit impulse.")
@click.option(
    "--unbalance",
    "places",
    multiple=True,
    metavar="POINT[=SIZE@PHASE]",
    help="Instead of inputs: the outputs that an unbalance of 1 kg m at this body or body.point causes, over its spin "
    "from --from to --to. Phases count from the moment at which the unbalance points along x. With a size (kg*m) and a "
    "phase by which it leads (degrees), such as disk.rim=2e-5@90, it may be repeated: unbalances that act together.",
)
@click.option(
    "--speed",
    metavar="PARAMETER[=RANGE]",
    help="With --unbalance: the parameter that is the spin of the body, with its range: omega=50..500.",
)
@click.option("--frozen", is_flag=True, help="Take the equations as they are at the reference time.")
@plot_option(
    *PICTURES,
    meaning="bode or nyquist; step, impulse or unbalance with these options",
)
@output_options("table", "json", "csv", unnamed="outputs of the model are chosen by --measured")
def response(
    file: str,
    settings: tuple[str, ...],
    sources: tuple[str, ...],
    goals: tuple[str, ...],
    start: str | None,
    stop: str | None,
    points: int,
    step: float | None,
    impulse: float | None,
    places: tuple[str, ...],
    speed: str | None,
    frozen: bool,
    pictures: tuple[str, ...],
    place: Path | None,
    output: Output,
) -> None:
    """Compute frequency and time responses, zeros and margins.

    They lead from the inputs: to the outputs: of the file. Zeros have error estimates; a transfer function is called
    minimum phase, or not, only where these decide it. Margins are those of the loop in which the output is subtracted
    from the input. Those of a controller in the file need its loop open: multiply its effort by a parameter that is 0,
    give an input where the effort acts, and the negative effort as an output. Frequencies are those of the eigenvalues
    and a decade beyond unless --from and --to say others.

    Example: mbstab response whipple_bicycle.yaml --input steer_torque
    """
    from mbstab.analysis.response.response import duration_of

    ends = (
        None if places else _frequency("--from", start),
        None if places else _frequency("--to", stop),
    )
    duration = duration_of(step, impulse, ends)
    if places or speed is not None:
        _refuse_beside_unbalance(places, speed, duration, bool(sources), frozen)
    possible = ("bode", "nyquist") if duration is None else ("impulse",) if step is None else ("step",)
    if places:
        possible = ("unbalance",)
    if wrong := [x for x in pictures if x not in possible]:
        raise UsageError(f"--plot {wrong[0]}: this response is drawn as {' or '.join(possible)}")
    mechanism = load_model(file, settings)
    paths = picture_paths(*picture_stem(place, output.path, Path(mechanism.model.name)), pictures)
    if places and speed is not None:
        ((name, span),) = parse_ranges((speed,), "--speed").items()
        _unbalance(mechanism, places, name, goals, (start, stop, points, False, None, span), paths, output)
        return
    result = mechanism.response(sources, goals, ends, points, step, impulse, frozen)
    warn(result.warnings)
    _write(result, mechanism.model, paths, output)


def _frequency(option: str, text: str | None) -> float | None:
    """Return a frequency that an option gives (rad/s)."""
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        raise UsageError(f"{option} {text}: a frequency is a number in rad/s") from None


def _write(result: Response, model: Model, paths: dict[str, Path], output: Output) -> None:
    """Write and draw responses from inputs to outputs."""
    output.answer(result, model)
    if paths:
        from mbstab.report.pictures.responses import nyquist, response_picture

        for name, path in paths.items():
            save_picture(partial(nyquist if name == "nyquist" else response_picture, result, model.title), path)


def _refuse_beside_unbalance(
    places: tuple[str, ...],
    speed: str | None,
    duration: float | None,
    sources: bool,
    frozen: bool,
) -> None:
    """Refuse what an unbalance response needs and does not have, or cannot have."""
    if not places or speed is None:
        raise UsageError("--unbalance and --speed go together: the point, and the parameter that is the spin")
    if duration is not None or sources or frozen:
        raise UsageError("--unbalance goes with none of --input, --step, --impulse and --frozen")


def _unbalance(
    mechanism: Mechanism,
    places: tuple[str, ...],
    speed: str,
    goals: tuple[str, ...],
    grid: tuple[str | None, str | None, int, bool, None, str | None],
    paths: dict[str, Path],
    output: Output,
) -> None:
    """Write and draw an unbalance response."""
    from mbstab.analysis.sweep.unbalance import read_unbalances
    from mbstab.model.ranges import sweep_values

    model = mechanism.model
    at = read_unbalances(places)
    speeds = sweep_values(model, speed, *grid)
    unit, factor = model.parameters[speed].unit or "rad/s", model.parameters[speed].factor
    if speeds.min() <= 0.0:
        ends = " to ".join(f"{x / factor:.6g}" for x in speeds[[0, -1]])
        raise UsageError(
            f"--unbalance needs positive spins, and {speed} goes from {ends} {unit}"
            + ("" if all(grid[:2]) or grid[-1] else f", as sweep: in {model.name} says")
            + f"\nhint: give both ends above 0, such as --from {max(speeds.max(), 100.0 * factor) / factor / 100.0:.6g}"
        )
    with progress_bar("unbalance") as progress:
        found = mechanism.unbalance(at, speed, speeds, goals, progress, si=True)
    output.answer(found, model)
    for path in paths.values():
        from mbstab.report.pictures.responses import unbalance_picture
        from mbstab.report.pictures.scales import Axis

        spin = Axis(speed, unit, factor, model.parameters[speed].description)
        save_picture(partial(unbalance_picture, found, model.title, spin), path)
