"""``mbstab equilibrium``: positions and steady motions in which the forces balance."""

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


@click.command()
@file_argument
@set_option
@click.option(
    "--starts", type=click.IntRange(1, 100_000), default=1, help="Try this many starts, the others at random."
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Of the random starts.")
@format_option("table", "json", "csv")
@output_option
def equilibrium(
    file: str, settings: tuple[str, ...], starts: int, seed: int, format_: str, output: Path | None
) -> None:
    """Find an equilibrium or a steady motion, with the forces and torques in the joints.

    The search starts from the reference of the file. Coordinates that it gives are held if it says find:, else they
    are starting values. With --starts all distinct solutions are listed.

    Example: mbstab equilibrium governor.yaml --set omega=20
    """
    mechanism = load_model(file)
    model = mechanism.model
    found = mechanism.equilibria(
        starts, seed, lambda items: tracked(items, "starts") if starts > 1 else iter(items), **parse_settings(settings)
    )
    warn(list(dict.fromkeys(text for item in found for text in item.motion.warnings)))
    if format_ == "json":
        from mbstab.report.export import equilibrium_data, to_json

        write(to_json(equilibrium_data(found, model.coordinates(), model.name, model.title)), output, model.name)
    elif format_ == "csv":
        from mbstab.report.export import equilibrium_csv

        write(equilibrium_csv(found, model.coordinates()), output, model.name)
    else:
        from mbstab.report.tables import equilibrium_text

        write(equilibrium_text(found, model.coordinates(), model.title), output, model.name)
