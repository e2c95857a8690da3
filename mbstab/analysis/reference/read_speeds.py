"""Speeds at which coefficients are read from files, beside those at which bodies turn."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.mechanics.vectors import plain_zero
from mbstab.model.arithmetic import FLOAT
from mbstab.model.scene import ItemValues


def misread(system: System, q: Array, u: Array) -> list[str]:
    """Return a warning if forces read their curves at speeds at which their first body does not turn.

    Spins count relative to the second body. Their sense about the axis counts where the coefficients couple both
    directions across it: this coupling turns with the shaft.
    """
    scene = system.scene
    numbers = {name: i for i, name in enumerate(scene.model.bodies)}
    items = {item.entry.path: item for item in scene.items}
    found: dict[str, list[str]] = {}
    turning = None
    for entry in scene.model.entries["forces"].values():
        bodies = [marker.body for marker in entry.values["between"]] if "curves" in entry.values else []
        if not bodies or not all(body is None or scene.bodies[numbers[body]].orientation for body in bodies):
            continue
        turning = Attitudes.of(system).spins(system, q, u) if turning is None else turning
        first, second = (np.zeros(3) if body is None else turning[numbers[body]] for body in bodies)
        spin = float(np.linalg.norm(first - second))
        read = float(entry.values["curves"]["speed"].evaluate(scene.parameters, FLOAT))
        about = ""
        if abs(spin - abs(read)) <= TOLERANCES.speed_of_curves * max(spin, abs(read)):
            item = items[entry.path]
            axis = np.array([0.0, 0.0, 1.0])
            if scene.dimension == 3:
                axis = np.array(item.triads("axis", "zero")[1].v1)
                if bodies[1] is not None:
                    axis = Attitudes.of(system).orientations(system, q)[numbers[bodies[1]]] @ axis
            turned = float((first - second) @ axis)
            if turned * read >= 0.0 or not _couples(item):
                continue
            spin, about = turned, " about the axis"
        text = f"read at {read:.6g} rad/s, and {(bodies[0] or bodies[1])!r} turns at {spin:.6g} rad/s{about}"
        found.setdefault(text, []).append(entry.called)
    if not found:
        return []
    told = "; those of ".join(f"{' and '.join(entries)} are {text}" for text, entries in found.items())
    whom, where = ("the body this rate", "speed") if len(found) == 1 else ("the bodies these rates", "speeds")
    return [f"the curves of {told}\nhint: give {whom} under reference.rates, or correct the {where} of the curves"]


def _couples(item: ItemValues) -> bool:
    """Whether coefficients couple the directions across the axis of a bearing."""
    curves = item.value("curves")
    return any(not plain_zero(curves[x] if x in curves else item.number(x)) for x in ("kxy", "kyx", "cxy", "cyx"))
