"""Parameters that only begin the search for an equilibrium."""

from __future__ import annotations

from collections.abc import Mapping

from mbstab.model.dependencies import equations_of, used_in
from mbstab.model.schema import Model, after_number


def idle(model: Model, start: Mapping[str, float]) -> tuple[str, ...]:
    """Return a warning for each parameter that changes nothing on a path of equilibria, as the guess alone uses it.

    Parameters
    ----------
    model : Model
    start : mapping
        The values (SI) of the parameters that vary, where the path begins.
    """
    asked = model.reference
    given = [asked.time, asked.coordinates, asked.rates, asked.steady, asked.period]
    used = used_in(model, [equations_of(model), given])
    found = []
    for name, value in start.items():
        if name not in used:
            parameter = model.parameters[name]
            at = f"{name} = {value / parameter.factor:.12g}{after_number(parameter.unit)}"
            found.append(
                f"only the guess of the reference uses {name}: the equilibrium found at {at} is the one "
                f"that is followed, and {name} does not change it\n"
                f"hint: mbstab eig --set {name}=VALUE begins the search elsewhere"
            )
    return tuple(found)
