"""``mbstab linearize``: the matrices of the linearized equations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mbstab.cli.common import load_model, model_command, plot_option, tracked
from mbstab.cli.mistakes import Choice
from mbstab.cli.output import (
    Output,
    note,
    output_options,
    picture_paths,
    picture_stem,
    save_picture,
    warn,
)
from mbstab.errors import UsageError, counted

if TYPE_CHECKING:
    from mbstab.analysis.linear.linearize import Linearization
    from mbstab.model.schema import Model

EQUATIONS = ("equations", "composite")
FORMS = (*EQUATIONS, "pencil", "state-space")


@model_command
@click.option(
    "--form",
    type=Choice(FORMS),
    default=FORMS[0],
    show_default=True,
    help="Which matrices a table shows; the other formats hold all of them.",
)
@click.option("--full", is_flag=True, help="Print large matrices, too; otherwise only their sizes are shown.")
@click.option("--frozen", is_flag=True, help="Write a steady motion in the coordinates of the file, frozen in time.")
@click.option(
    "--states",
    metavar="X,...",
    help="States of A, B, C, D: coordinates, angle(joint), displacement(joint), place(body.point.x) and rate(...) of "
    "these; else chosen so that the map from them is well conditioned, in the order of the file: coordinates of "
    "bodies, first-order states, then rates of coordinates. Fewer than all will do if their rates depend "
    "on them only, such as roll and steer of a bicycle.",
)
@click.option("--symbolic", is_flag=True, help="Print the blocks of the composite matrices with symbols.")
@plot_option("pencil", meaning="pencil: the pattern of s E - A, with its blocks labelled by body and joint")
@output_options("table", "json", "csv", "npz", "mat", "latex")
def linearize(
    file: str,
    settings: tuple[str, ...],
    form: str,
    full: bool,
    frozen: bool,
    states: str | None,
    symbolic: bool,
    pictures: tuple[str, ...],
    place: Path | None,
    output: Output,
) -> None:
    """Print the linearized equations as matrices.

    These are mass, damping and stiffness matrices, constraint rows, descriptor form and state space. The state space A,
    B, C, D belongs to the sections inputs: and outputs: of the file.

    Example: mbstab linearize whipple_bicycle.yaml --form state-space
    """
    if symbolic and states is not None:
        raise UsageError("--symbolic shows the blocks of coordinates; --states has no effect with it")
    if symbolic and pictures:
        raise UsageError("--plot draws numbers; it goes without --symbolic")
    if symbolic:
        _symbolic(file, settings, frozen, output)
        return
    mechanism = load_model(file, settings)
    model = mechanism.model
    paths = picture_paths(*picture_stem(place, output.path, Path(model.name)), pictures)
    linear = mechanism.linearize(frozen)
    from mbstab.analysis.verdict.facts import warnings_of

    warn(warnings_of(linear))
    _write(linear, model, form, states, full, output)
    for path in paths.values():
        from mbstab.report.pictures.pencil import pencil_pattern

        save_picture(lambda: pencil_pattern(linear, model.title), path)


def _write(linear: Linearization, model: Model, form: str, states: str | None, full: bool, output: Output) -> None:
    """Write the matrices; the control model is built only where it is asked for or the file has inputs or outputs."""
    from mbstab.analysis.response.state_space import control_model, split_states

    table = {"form": form, "full": full}
    ported = bool(model.outputs or linear.system.scene.inputs)
    if output.format == "table" and form in EQUATIONS and states is None and not ported:
        output.answer(linear, model, table=table)
    else:
        output.answer(control_model(linear, split_states(states or "")), model, table=table)


def _symbolic(file: str, settings: tuple[str, ...], frozen: bool, output: Output) -> None:
    """Write the blocks with symbols."""
    if output.format not in ("table", "latex"):
        raise UsageError("--symbolic goes with the formats table and latex")
    if frozen:
        raise UsageError(
            "--symbolic shows the equations in the coordinates of the file; --frozen has no effect with it"
        )
    if settings:
        raise UsageError("--symbolic shows parameters as symbols; --set has no effect with it")
    mechanism = load_model(file)
    blocks = mechanism.symbolic(lambda entries: tracked(entries, "simplifying"))
    if blocks.unsimplified:
        many = counted(blocks.unsimplified, "entry is", "entries are")
        note(f"{many} not simplified, which would take too long: they have many operations or several angles")
    output.answer(blocks, mechanism.model)
