"""``mbstab linearize``: the matrices of the linearized equations."""

from __future__ import annotations

from pathlib import Path

import click

from mbstab.cli.common import (
    file_argument,
    format_option,
    load_model,
    output_option,
    parse_settings,
    set_option,
    tracked,
    warn,
    write,
)
from mbstab.errors import UsageError

FORMS = ("equations", "composite", "pencil", "state-space")


@click.command()
@file_argument
@set_option
@click.option(
    "--form",
    type=click.Choice(FORMS),
    default=FORMS[0],
    show_default=True,
    help="Which matrices a table shows; the other formats hold all of them.",
)
@click.option("--frozen", is_flag=True, help="Write a steady motion in the coordinates of the file, frozen in time.")
@click.option("--symbolic", is_flag=True, help="Print the blocks of the composite matrices with symbols.")
@format_option("table", "json", "csv", "npz", "mat", "latex")
@output_option
def linearize(
    file: str,
    settings: tuple[str, ...],
    form: str,
    frozen: bool,
    symbolic: bool,
    format_: str,
    output: Path | None,
) -> None:
    """Print mass, damping and stiffness matrices, constraint rows, pencil and state space.

    Example: mbstab linearize pendulum.yaml --symbolic
    """
    if format_ == "latex" and not symbolic:
        raise UsageError("--format latex goes with --symbolic")
    if symbolic and format_ not in ("table", "latex"):
        raise UsageError("--symbolic goes with --format table or latex")
    if format_ in ("npz", "mat") and output is None:
        raise UsageError(f"--format {format_} needs --output")
    parameters = parse_settings(settings)
    if symbolic and frozen:
        raise UsageError(
            "--symbolic shows the equations in the coordinates of the file; --frozen has no effect with it"
        )
    if symbolic and parameters:
        raise UsageError("--symbolic shows parameters as symbols; --set has no effect with it")
    mechanism = load_model(file)
    model = mechanism.model
    if symbolic:
        from mbstab.report.symbolic import symbolic_latex, symbolic_text

        blocks = mechanism.symbolic(lambda entries: tracked(entries, "simplifying"))
        write(
            symbolic_latex(blocks) if format_ == "latex" else symbolic_text(blocks, model.title),
            output,
            mechanism.model.name,
        )
        return
    from mbstab.analysis.linearize import state_space
    from mbstab.report import export

    linear = mechanism.linearize(frozen, **parameters)
    warn(linear.motion.warnings)
    space = state_space(linear)
    data: str | bytes
    if format_ == "json":
        data = export.to_json(export.linearize_data(linear, space, model.name, model.title))
    elif format_ == "csv":
        data = export.linearize_csv(linear, space)
    elif format_ == "npz":
        data = export.npz_bytes(export.linearize_arrays(linear, space))
    elif format_ == "mat":
        data = export.mat_bytes(export.linearize_arrays(linear, space))
    else:
        from mbstab.report.tables import linearize_text

        data = linearize_text(linear, space, form, model.title)
    write(data, output, mechanism.model.name)
