"""``mbstab energy``: the energies at the reference, and the power of what is not conservative."""

from __future__ import annotations

from mbstab.cli.common import load_model, model_command
from mbstab.cli.output import Output, output_options, warn


@model_command
@output_options("table", "json")
def energy(file: str, settings: tuple[str, ...], output: Output) -> None:
    """Show energies at the reference, and the power of forces.

    These are kinetic and potential energy, and the power of forces without a potential, dampers and drives.
    The sum of the powers is the rate at which the energy changes: zero where a motion goes on steadily.

    Example: mbstab energy governor.yaml
    """
    mechanism = load_model(file, settings)
    found, model = mechanism.energies(), mechanism.model
    warn(found.motion.warnings)
    output.answer(found, model)
