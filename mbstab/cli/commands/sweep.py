"""``mbstab sweep``: eigenvalues over a parameter, and where stability changes."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbstab.analysis.sweep.settings import SweepSettings
from mbstab.cli import completion
from mbstab.cli.common import (
    file_argument,
    force_option,
    listed,
    load_model,
    parse_ranges,
    plot_option,
    progress_bar,
    set_option,
)
from mbstab.cli.output import (
    Output,
    note,
    output_options,
    picture_paths,
    picture_stem,
    save_picture,
    warn,
)
from mbstab.errors import NumericalError, UsageError, alternatives, counted
from mbstab.model.units import is_angular_velocity

if TYPE_CHECKING:
    from mbstab.analysis.sweep.chart import Chart
    from mbstab.analysis.sweep.sweep import Sweep
    from mbstab.api import Mechanism
    from mbstab.compiler.system import Array
    from mbstab.model.schema import Model
    from mbstab.report.pictures.scales import Axis

PICTURES = ("map", "locus", "campbell", "path", "none")
CHART_POINTS = 101


@click.command()
@file_argument
@click.option(
    "--param",
    "parameters",
    metavar="NAME[=RANGE]",
    multiple=True,
    required=True,
    shell_complete=completion.parameters,
    help="Parameter to sweep, with its range: d=0.1..10, or d=5% about its value; a second one makes a stability "
    "chart.",
)
@click.option(
    "--from",
    "start",
    metavar="VALUE",
    multiple=True,
    callback=listed(),
    help="First value, if the range is given apart: in the parameter's unit or an expression; with two parameters one "
    "for each: A,B or repeated.",
)
@click.option("--to", "stop", metavar="VALUE", multiple=True, callback=listed(), help="Last value.")
@click.option(
    "--points",
    multiple=True,
    callback=listed(click.IntRange(2, 10_000_000)),
    metavar="NUMBER",
    help="Number of values.",
)
@click.option("--log", "logarithmic", is_flag=True, help="Space the values logarithmically.")
@click.option("--values", metavar="LIST", help="The values themselves, separated by commas.")
@set_option
@force_option
@plot_option(
    *PICTURES,
    meaning="map and locus if not given, none for none",
)
@click.option(
    "--orders",
    callback=listed(click.FLOAT),
    metavar="K,...",
    multiple=True,
    help="List where frequencies cross these multiples of the parameter, an angular velocity, and draw their lines in "
    "--plot campbell, which shows the first order if none is given.",
)
@click.option("--max-frequency", type=float, metavar="HZ", help="End of the axis of --plot campbell.")
@click.option(
    "--coordinate",
    "coordinates",
    callback=listed(),
    metavar="NAME,...",
    multiple=True,
    help="What --plot path draws, such as apex.y or rate(car.psi); else what the parameter changes most.",
)
@click.option("--meetings", is_flag=True, help="Print where branches cross or collide.")
@click.option("--certify", is_flag=True, help="Prove each critical value: enclose it in a ball, or say why not.")
@click.option(
    "--sensitivity",
    is_flag=True,
    help="Print the derivative of each critical value by each other parameter, what moves it most per percent first; "
    "CSV holds these alone.",
)
@click.option("--resume", is_flag=True, help="Go on with a sweep to --output that was interrupted.")
@click.option("--jobs", type=click.IntRange(1, 1024), default=1, show_default=True, help="Number of processes.")
@click.option("--cluster", metavar="ADDRESS", default="", help="Compute on a Dask cluster, tcp://HOST:PORT.")
@output_options("table", "json", "csv", "npz")
def sweep(
    file: str,
    parameters: tuple[str, ...],
    start: tuple[str, ...],
    stop: tuple[str, ...],
    points: tuple[int, ...],
    logarithmic: bool,
    values: str | None,
    settings: tuple[str, ...],
    pictures: tuple[str, ...],
    place: Path | None,
    orders: tuple[float, ...],
    max_frequency: float | None,
    coordinates: tuple[str, ...],
    meetings: bool,
    certify: bool,
    sensitivity: bool,
    resume: bool,
    jobs: int,
    cluster: str,
    output: Output,
) -> None:
    """Find where stability changes over one or two parameters.

    The eigenvalues are followed over the parameter. With two parameters the verdicts over both are drawn as a chart.
    The range is that of the file's sweep: block unless given; from a larger value to a smaller one the table goes down,
    too, while axes of pictures grow. The terminal shows the critical values; all branches go to --output as CSV, JSON
    or npz, and pictures beside it.

    Example: mbstab sweep top.yaml --param omega=0..12 -o top.csv
    """
    given = {"--from": start, "--to": stop, "--points": points}
    spans = parse_ranges(parameters, "--param")
    parameters = tuple(spans)
    _check_options(parameters, given, values is not None)
    single = {"--certify": certify, "--sensitivity": sensitivity, "--orders": orders, "--meetings": meetings}
    _check_asked([name for name, chosen in single.items() if chosen], parameters, output.format)
    if max_frequency is not None and ("campbell" not in pictures or not 0.0 < max_frequency < float("inf")):
        raise UsageError("--max-frequency goes with --plot campbell, and is a positive number of Hz")
    directory = output.path.with_name(output.path.name + ".parts") if output.path is not None else None
    run = SweepSettings(directory, True, resume, jobs, cluster)
    mechanism = load_model(file, settings)
    model = mechanism.model
    grids = _grids(model, spans, given, logarithmic, values)
    _check_path(model, parameters, pictures, coordinates)
    stem = picture_stem(place, output.path, Path(model.name), "-".join(parameters))
    wanted = pictures or (("map", "locus") if output.format == "table" or output.path is not None else ())
    drawn = () if "none" in wanted else wanted
    paths = picture_paths(*stem, drawn if len(parameters) == 1 else ("chart",) * bool(drawn))
    if len(parameters) == 1:
        if "campbell" in paths and is_angular_velocity(model.parameters[parameters[0]].unit):
            orders = orders or (1.0,)
        asked = {name[2:]: chosen for name, chosen in single.items()} | {"orders": orders, "detail": bool(paths)}
        total, missing, reason = _sweep(
            mechanism, parameters[0], grids, run, paths, output, asked, (max_frequency, coordinates)
        )
    else:
        total, missing, reason = _chart(mechanism, grids, run, paths, output)
    if missing:
        rest = "; the others are computed" if missing < total else ""
        raise NumericalError(f"{missing} of {total} points have no answer{rest}{reason}")


def _sweep(
    mechanism: Mechanism,
    parameter: str,
    grids: dict[str, Array],
    run: SweepSettings,
    paths: dict[str, Path],
    output: Output,
    asked: dict[str, Any],
    drawn: tuple[float | None, tuple[str, ...]],
) -> tuple[int, int, str]:
    """Sweep a parameter, write and draw the answer; return how many points there are, how many have no answer, and why.

    The reason is that of the first one, with its value.
    """
    model = mechanism.model
    with _kept(run.directory, output.path):
        alone = not (asked["certify"] or asked["sensitivity"])
        with progress_bar("sweeping", alone * len(grids[parameter])) as progress:
            answer = mechanism.sweep(parameter, grids[parameter], progress, si=True, **asked, **vars(run))
        derived = {"sensitivity": asked["sensitivity"]}
        output.answer(answer, model, True, table=derived, json=derived, csv=derived)
        if len(answer.unanswered) < len(answer.values):
            _draw(answer, paths, partial(_axis, model, parameter, answer.values), model.title, *drawn)
    warn(list(dict.fromkeys(x for path in (answer, *answer.beyond) for x in path.warnings)))
    missing = answer.unanswered
    told = next((i for i in missing if i in answer.problems), None)
    reason = "" if told is None else _reason(model, {parameter: answer.values[told]}, answer.problems[told])
    return len(answer.values), len(missing), reason


def _chart(
    mechanism: Mechanism, grids: dict[str, Array], run: SweepSettings, paths: dict[str, Path], output: Output
) -> tuple[int, int, str]:
    """Compute a chart, write and draw it; return the same as `_sweep`."""
    model = mechanism.model
    with _kept(run.directory, output.path):
        with progress_bar("sweeping", math.prod(map(len, grids.values()))) as progress:
            answer = mechanism.chart(grids, progress, si=True, **vars(run))
        output.answer(answer, model, True)
        for path in paths.values() if len(answer.problems) < answer.unstable.size else ():
            _draw_chart(answer, path, model)
    warn(answer.warnings)
    reason = ""
    for i, problem in list(answer.problems.items())[:1]:
        at = answer.x[i % len(answer.x)], answer.y[i // len(answer.x)]
        reason = _reason(model, dict(zip(answer.parameters, at, strict=True)), problem)
    return answer.unstable.size, len(answer.problems), reason


def _reason(model: Model, at: dict[str, float], problem: str) -> str:
    """Return a line that says why the first point without an answer, at values in SI, has none."""
    from mbstab.model.ranges import in_unit

    where = " and ".join(f"{name} = {in_unit(model, name, float(x))}" for name, x in at.items())
    return f"\nthe first one, at {where}: {problem.splitlines()[0]}"


def _check_options(
    parameters: tuple[str, ...],
    given: dict[str, tuple[Any, ...]],
    listed: bool,
) -> None:
    """Refuse options that exclude each other."""
    if len(parameters) > 2:
        raise UsageError("a sweep has one parameter, a chart two different ones")
    if joined := [name for name in parameters if "," in name]:
        separate = " ".join(f"--param {part.strip()}" for part in joined[0].split(","))
        raise UsageError(f"--param {joined[0]} names more than one parameter\nhint: {separate}")
    for name, values in given.items():
        if values and len(values) != len(parameters):
            times = "once" if len(values) == 1 else f"{len(values)} times"
            message = f"{name} is given {times} for {counted(len(parameters), 'parameter')}: once for each"
            hint = "\nhint: commas stand between the values of two parameters, and decimals have a point"
            raise UsageError(message + hint * (len(values) > len(parameters)))
    if len(parameters) == 2 and listed:
        raise UsageError("--values goes with one parameter")


def _check_asked(options: list[str], parameters: tuple[str, ...], form: str) -> None:
    """Refuse options of sweeps with a chart, and derivatives in a format without them."""
    if len(parameters) == 2 and options:
        raise UsageError(f"{options[0]} goes with one parameter")
    if "--sensitivity" in options and form == "npz":
        raise UsageError("--sensitivity goes with the formats table, json and csv")


def _check_path(
    model: Model, parameters: tuple[str, ...], pictures: tuple[str, ...], coordinates: tuple[str, ...]
) -> None:
    """Refuse a picture of references that are not found, and coordinates without one."""
    if coordinates and "path" not in pictures:
        raise UsageError("--coordinate goes with --plot path")
    if "path" in pictures and len(parameters) == 1 and model.reference.find is None:
        raise UsageError(
            "--plot path draws a reference that is found, and the coordinates of this one are given or follow from "
            "the constraints\nhint: reference: has a key find:, see mbstab manual model-file"
        )
    known = [*model.coordinates(), *model.outputs]
    for name in coordinates:
        if name.removeprefix("rate(").removesuffix(")") not in known:
            hint = alternatives(name, known, "coordinates and outputs")
            raise UsageError(f"--coordinate {name}: no coordinate, rate or output\nhint: {hint}")


def _grids(
    model: Model,
    spans: dict[str, str | None],
    given: dict[str, tuple[Any, ...]],
    logarithmic: bool,
    values: str | None,
) -> dict[str, Array]:
    """Return the values of each parameter."""
    from mbstab.model.ranges import sweep_values

    grids = {}
    for i, (name, span) in enumerate(spans.items()):
        first, last, count = (x[i] if x else None for x in given.values())
        if count is None and len(spans) == 2:
            count = _chart_points(model, name)
        grids[name] = sweep_values(model, name, first, last, count, logarithmic, values, span)
    return grids


@contextlib.contextmanager
def _kept(directory: Path | None, written: Path | None) -> Iterator[None]:
    """Remove finished parts when the answer is written; if it is not, print where they are kept."""
    from mbstab.analysis.sweep.jobs import discard

    before = _written_at(written)
    try:
        yield
    except BaseException as error:
        if directory is not None and _written_at(written) != before:
            discard(directory)  # only the summary on the terminal, or a picture, is missing
        elif directory is not None and not isinstance(error, UsageError):
            what = "interrupted: " if isinstance(error, KeyboardInterrupt) else ""
            if any(directory.glob("block-*")):
                note(f"{what}finished blocks are kept in {directory}; go on with --resume")
            elif directory.exists():
                discard(directory)
                note(f"{what}no block of points was finished, and nothing is kept")
        raise
    if directory is not None:
        discard(directory)


def _written_at(path: Path | None) -> int | None:
    """Return when a file was written (ns), or None if it does not exist."""
    return path.stat().st_mtime_ns if path is not None and path.exists() else None


def _chart_points(model: Model, parameter: str) -> int:
    """Return the number of values along a side of a chart: that of the file, if it is not too many."""
    return min(model.sweep[parameter].points, CHART_POINTS) if parameter in model.sweep else CHART_POINTS


def _draw_chart(result: Chart, path: Path, model: Model) -> None:
    from mbstab.report.pictures.stability_chart import chart
    from mbstab.report.pictures.sweep_curves import unanswered_text

    one, other = (_axis(model, name, x) for name, x in zip(result.parameters, (result.x, result.y), strict=True))
    missing = unanswered_text(bool(result.problems), int((result.unstable < 0).sum()) > len(result.problems))
    fine = result.detail
    grid = fine.x, fine.y, fine.unstable, fine.oscillating, result.verdicts_of_detail
    save_picture(lambda: chart(*grid, result.boundaries, (one, other), model.title, missing, result.divisions), path)


def _draw(
    result: Sweep,
    paths: dict[str, Path],
    axis: Callable[[], Axis],
    title: str,
    max_frequency: float | None,
    coordinates: tuple[str, ...],
) -> None:
    """Draw pictures of a sweep to their files."""
    if not paths:
        return
    from mbstab.report.pictures.bifurcation import bifurcation
    from mbstab.report.pictures.campbell import campbell
    from mbstab.report.pictures.root_locus import root_locus
    from mbstab.report.pictures.stability_map import stability_map

    limited = campbell if max_frequency is None else partial(campbell, highest=max_frequency)
    kinds = {"map": stability_map, "locus": root_locus, "campbell": limited}
    kinds["path"] = partial(bifurcation, asked=coordinates)
    for picture, path in paths.items():
        save_picture(partial(kinds[picture], result, axis(), title), path)


def _axis(model: Model, name: str, values: Array) -> Axis:
    """Return the axis of a parameter, logarithmic if its values are spaced so."""
    from mbstab.report.pictures.scales import Axis, is_geometric

    parameter = model.parameters[name]
    return Axis(name, parameter.unit, parameter.factor, parameter.description, is_geometric(values))
