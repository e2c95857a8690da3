"""What is said of references at which ranks cannot be decided, or forces do not balance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.compiler.system import Array, System
from mbstab.model.bare_degrees import bare_degrees
from mbstab.model.scene import Scene
from mbstab.model.schema import is_length


def singular_configuration(curvature: float, rows: list[str]) -> str:
    """Return the message for rows that depend on each other at the reference only."""
    return (
        "the mechanism is at a singular configuration: constraints that are independent nearby depend on "
        f"each other here (curvature {curvature:.3g})\nthe rows involved: {'; '.join(rows)}\n"
        "hint: eigenvalues do not exist at such a point; move the reference away from it"
    )


def inertias_too_far_apart(system: System, M: Any, sizes: Array) -> str:
    """Return what to say where inertias differ by so much that double precision cannot tell ranks; else nothing."""
    diagonal = M.diagonal()
    moved = np.flatnonzero(diagonal > 0.0)
    if not len(moved):
        return ""
    # Squares of sizes may leave the range of double precision.
    inertia = np.log10(diagonal[moved]) + 2.0 * np.log10(sizes[moved])
    heavy, light = moved[np.argmax(inertia)], moved[np.argmin(inertia)]
    decades, most = float(np.ptp(inertia)), -2.0 * math.log10(ALGEBRA.singular_value_zero)
    if decades < most:
        return ""

    def shown(i: np.intp) -> str:
        return f"{diagonal[i]:.3g} {'kg' if is_length(system.names[i]) else 'kg*m^2'} along {system.names[i]}"

    return (
        f"the inertias are too far apart for double precision: {shown(heavy)}, {shown(light)} "
        f"(ratio 1e{decades:.0f}, at most 1e{most:.0f})\n"
        "hint: correct the larger or the smaller; what is meant to stand still can be joined to ground"
    )


def turns_and_degrees(scene: Scene) -> str:
    """Return the end of a hint about the first given angle of more than a turn (rad); empty: there is none."""
    for name, value in scene.coordinates.items():
        if "." in name and not is_length(name) and abs(value) > 2.0 * math.pi:
            turns = f"{value / (2.0 * math.pi):.3g} turns"
            return f"; {name}: {value:g} rad are {turns}, and degrees are written {value:g}*deg"
    for text in bare_degrees(scene.model):
        return f"; {text}".replace("\nhint: ", ", and ")
    return ""
