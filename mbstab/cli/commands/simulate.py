"""``mbstab simulate``: the nonlinear motion."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mbstab.cli import completion
from mbstab.cli.animate import POINTS, Animation, animation_options
from mbstab.cli.common import (
    file_argument,
    force_option,
    load_model,
    parse_settings,
    progress_bar,
    refuse_given,
    set_option,
)
from mbstab.cli.mistakes import Choice
from mbstab.cli.output import (
    Output,
    check_pictures,
    note,
    output_options,
    picture_paths,
    picture_stem,
    pictures_option,
    save_picture,
    say_error,
    warn,
)
from mbstab.errors import SimulationError

if TYPE_CHECKING:
    from mbstab.analysis.simulate.result import Simulation
    from mbstab.analysis.simulate.settings import SimulationSettings
    from mbstab.api import Mechanism
    from mbstab.model.schema import Model
    from mbstab.report.pictures.motion_plots import Picture

METHODS = ("projection", "alpha", "radau")
SOLVERS = ("DOP853", "RK45", "Radau", "BDF")


@click.command()
@file_argument
@click.option("--to", type=float, metavar="T", help="Last time (s); 10 s after the start if not given.")
@click.option("--from", "start", type=float, metavar="T0", help="First time (s); that of the file if not given.")
@set_option
@force_option
@click.option(
    "--method",
    type=Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="projection: accelerations and a --solver, back onto the constraints after each step; alpha: "
    "generalized-alpha on the index-3 equations, order 2; radau: Radau IIA for stiff motions, order 5.",
)
@click.option(
    "--solver",
    type=Choice(SOLVERS),
    help="With --method projection: DOP853 (order 8, the default), RK45, or for stiff motions Radau, BDF.",
)
@click.option("--tol", type=float, default=1e-8, show_default=True, help="Error of the result, relative to the scene.")
@click.option("--step", type=float, metavar="H", help="Fixed step (s), without control of the error.")
@click.option(
    "--compiled",
    is_flag=True,
    help="Take the steps of DOP853, RK45, alpha and radau in machine code; needs pip install 'mbstab[fast]'.",
)
@click.option("--once", is_flag=True, help="Make one run in which --tol is the error of a step: faster, error unknown.")
@click.option(
    "--points",
    type=click.IntRange(2, 10_000_000),
    help=f"Times of output; {POINTS} if not given, with --animate one for each frame at least.",
)
@click.option(
    "--perturb",
    "disturbances",
    metavar="NAME=VALUE",
    multiple=True,
    help='Add to the reference motion, in SI or with a unit: rod.theta=0.01, "rod.theta=10 deg", '
    "angle(pivot)=0.01 or displacement(…) of a joint, "
    "rate(rod.theta)=0.1, rate(angle(pivot))=0.1, or mode:1=0.01, a mode of mbstab eig. What else is free stays as it "
    "is. May be repeated.",
)
@click.option(
    "--through-singular",
    is_flag=True,
    help="Continue smoothly where the constraints lose rank, and say when; refused otherwise.",
)
@click.option("--strict", is_flag=True, help="Refuse initial values that the constraints do not allow.")
@click.option(
    "--plot",
    "plots",
    metavar="WHAT",
    multiple=True,
    shell_complete=completion.quantities,
    help="Pictures to draw, repeated for several ones; --pictures says where to. Over time: rod.theta, an output of "
    "the file, rate(rod.theta), acceleration(…), angle(pivot) or displacement(…) of a joint, rate(angle(pivot)), "
    "force(pivot), torque(pivot.z), effort(spring), kinetic, …, several with commas in one picture; energy; residuals; "
    "or phase:rod.theta.",
)
@pictures_option
@animation_options
@click.option("--full", is_flag=True, help="Show all coordinates in the table, not only the first 40.")
@output_options("table", "json", "csv", "npz")
def simulate(
    file: str,
    settings: tuple[str, ...],
    points: int | None,
    disturbances: tuple[str, ...],
    plots: tuple[str, ...],
    place: Path | None,
    full: bool,
    output: Output,
    **options: Any,
) -> None:
    """Follow the nonlinear motion, with reactions and energies.

    It starts at the reference of the file, or where its initial: block says, with what --perturb adds. --tol holds for
    the result: it is computed again with smaller steps until the estimate of its error is below. What is finished
    when the motion ends early, by a failure or by Ctrl-C, is written all the same, the animation only after a failure.

    Example: mbstab simulate pendulum.yaml --perturb rod.theta=pi/4 --to 20 -o pendulum.csv
    """
    from mbstab.analysis.simulate.settings import SimulationSettings

    _check_options(options["mode"] is not None, options["step"] is not None, bool(plots))
    own = {field.name: options.pop(field.name) for field in fields(SimulationSettings) if field.name in options}
    perturb = parse_settings(disturbances, "--perturb")
    run = SimulationSettings(**own, points=points or POINTS, perturb=perturb)
    movie = Animation.of(**options)
    check_pictures(place)
    mechanism = load_model(file, settings)
    model = mechanism.model
    pictures = _pictures(plots, model)
    names = [picture.name for picture in pictures]
    paths = picture_paths(*picture_stem(place, output.path, Path(model.name)), names, movie is not None)
    if movie is not None:
        movie.check(mechanism.system())
        if movie.mode is not None:
            movie.write_mode(mechanism)
            return
        run = replace(run, points=points or movie.points(mechanism.system(), run.start, run.to))
    result, stopped = _run(mechanism, run)
    output.answer(result, model, True, table={"full": full}, json={"whole": output.path is not None})
    _draw(result, pictures, paths, model)
    if movie is not None and stopped is not None and not result.failure:
        note("not animated, as the simulation was stopped")
    elif movie is not None:
        movie.write_motion(mechanism.system(), result, model.title)
    if stopped is not None:
        raise click.exceptions.Exit(stopped.exit_code)


def _run(mechanism: Mechanism, settings: SimulationSettings) -> tuple[Simulation, SimulationError | None]:
    """Return the simulation, and why it ended early if it did."""
    told: list[str] = []

    def tell(text: str) -> None:
        told.append(text)
        warn([text])

    stopped: SimulationError | None = None
    try:
        with _compiling(settings.compiled), progress_bar("simulating") as progress:
            result = mechanism.simulate(progress=progress, tell=tell, **vars(settings))
    except SimulationError as error:
        if error.partial is None or not len(error.partial.times):
            raise
        stopped, result = error, error.partial
        say_error(error)  # before what is kept of the motion
    warn([text for text in result.warnings if text not in told])
    return result, stopped


SIMULATED = (
    "to", "start", "method", "solver", "tol", "step", "compiled", "once", "points", "disturbances", "through_singular",
    "strict", "plots", "place", "format_", "output", "full", "speed",
)  # fmt: skip
"""Options that do not apply to a linear mode."""


@contextlib.contextmanager
def _compiling(compiled: bool) -> Iterator[None]:
    """Tell the user when steps are being compiled, and how far that is."""
    if not compiled:
        yield
        return
    from mbstab.analysis.simulate.steppers.compiled import machine_code

    with progress_bar("compiling") as show:

        def tell(done: float) -> None:
            if not done:
                note("the steps are compiled, the first time only")
            show(done)

        with machine_code().telling(tell):
            yield


def _check_options(mode: bool, step: bool, plots: bool) -> None:
    """Refuse options that would be ignored."""
    if mode:
        refuse_given(SIMULATED, "with --mode-shape, for which nothing is simulated: a mode takes 2 s, whatever it is")
    if step:
        refuse_given(("tol", "once"), "with --step: one run with fixed steps has no tolerance")
    if not plots:
        refuse_given(("place",), "without --plot")


def _pictures(plots: tuple[str, ...], model: Model) -> list[Picture]:
    """Read the requested pictures, before anything is computed."""
    if not plots:
        return []
    from mbstab.report.pictures.motion_plots import read_picture

    found: dict[str, Picture] = {}
    for text in dict.fromkeys(plots):
        picture = read_picture(model, text)
        name, number = picture.name, 2
        while name in found:  # long lists may begin with the same names
            name, number = f"{picture.name}-{number}", number + 1
        found[name] = replace(picture, name=name)
    return list(found.values())


def _draw(result: Simulation, pictures: list[Picture], paths: dict[str, Path], model: Model) -> None:
    """Draw pictures to their files."""
    if not pictures:
        return
    from mbstab.report.pictures.motion_plots import draw, idle

    for picture in pictures:
        for text in idle(picture, result, model):
            note(text)
        save_picture(partial(draw, picture, result, model.title), paths[picture.name])
