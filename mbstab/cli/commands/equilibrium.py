"""``mbstab equilibrium``: positions and steady motions in which the forces balance."""

from __future__ import annotations

import click

from mbstab.cli.common import load_model, model_command, tracked
from mbstab.cli.output import Output, output_options, warn


@model_command
@click.option(
    "--starts", type=click.IntRange(1, 100_000), default=1, help="Try this many starts, the others at random."
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Seed of the random starts.")
@output_options("table", "json", "csv")
def equilibrium(file: str, settings: tuple[str, ...], starts: int, seed: int, output: Output) -> None:
    """Find an equilibrium or a steady motion, with reactions.

    The search starts from the reference of the file. Coordinates that it gives are held if it says find:, else they
    are starting values. With --starts all distinct solutions are listed.

    Example: mbstab equilibrium governor.yaml --set omega=20
    """
    mechanism = load_model(file, settings)
    found = mechanism.equilibria(starts, seed, lambda items: tracked(items, "starts") if starts > 1 else iter(items))
    warn(list(dict.fromkeys(text for item in found for text in item.motion.warnings)))
    output.answer(found, mechanism.model)
