"""Parameters of a sweep that change nothing, or only where the search for an equilibrium begins."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mbstab.model.dependencies import equations_of, used_in
from mbstab.model.schema import Model, after_number


def idle(model: Model, names: Iterable[str], start: Mapping[str, float] | None) -> tuple[str, ...]:
    """Return a warning for each parameter that changes no eigenvalue, as at most the guess of the reference uses it.

    Parameters
    ----------
    model : Model
    names : iterable of str
        The parameters that vary.
    start : mapping or None
        Their values (SI) where a path of equilibria begins; None where no reference is searched for.
    """
    asked = model.reference
    given = [asked.time, asked.coordinates, asked.rates, asked.steady, asked.period]
    used, guesses = used_in(model, [equations_of(model), given]), used_in(model, [asked.guess, asked.guess_rates])
    found = []
    for name in names:
        if name in used:
            continue
        if name not in guesses:
            found.append(f"neither the equations of motion nor the reference use {name}: it changes no eigenvalue")
        elif start is not None:
            parameter = model.parameters[name]
            at = f"{name} = {start[name] / parameter.factor:.12g}{after_number(parameter.unit)}"
            found.append(
                f"only the guess of the reference uses {name}: the equilibrium found at {at} is the one "
                f"that is followed, and {name} does not change it\n"
                f"hint: mbstab eig --set {name}=VALUE begins the search elsewhere"
            )
    return tuple(found)
