"""Speeds at which coefficients are read from files, beside those at which bodies turn."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.model.arithmetic import FLOAT


def misread(system: System, q: Array, u: Array) -> list[str]:
    """Return a warning if forces read their curves at speeds at which their first body does not turn.

    Spins count relative to the second body, and without a sign.
    """
    scene = system.scene
    numbers = {name: i for i, name in enumerate(scene.model.bodies)}
    found: dict[str, list[str]] = {}
    turning = None
    for entry in scene.model.entries["forces"].values():
        bodies = [marker.body for marker in entry.values["between"]] if "curves" in entry.values else []
        if not bodies or not all(body is None or scene.bodies[numbers[body]].orientation for body in bodies):
            continue
        turning = Attitudes.of(system).spins(system, q, u) if turning is None else turning
        first, second = (np.zeros(3) if body is None else turning[numbers[body]] for body in bodies)
        spin = float(np.linalg.norm(first - second))
        read = abs(float(entry.values["curves"]["speed"].evaluate(scene.parameters, FLOAT)))
        if abs(spin - read) > TOLERANCES.speed_of_curves * max(spin, read):
            text = f"read at {read:.6g} rad/s, and {(bodies[0] or bodies[1])!r} turns at {spin:.6g} rad/s"
            found.setdefault(text, []).append(entry.called)
    if not found:
        return []
    told = "; those of ".join(f"{' and '.join(entries)} are {text}" for text, entries in found.items())
    whom, where = ("the body this rate", "speed") if len(found) == 1 else ("the bodies these rates", "speeds")
    return [f"the curves of {told}\nhint: give {whom} under reference.rates, or correct the {where} of the curves"]
