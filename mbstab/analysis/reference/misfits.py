"""What in a motion does not fit the coefficients of its forces: speeds of curves, headings of tyres."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.read_speeds import misread
from mbstab.compiler.system import Array, System
from mbstab.mechanics.tyres import place_of


def misfits(system: System, q: Array, u: Array) -> list[str]:
    """Return the warnings about a motion whose speeds are others than those for which its coefficients hold."""
    return [*misread(system, q, u), *_astern(system, q, u)]


def _astern(system: System, q: Array, u: Array) -> list[str]:
    """Return a warning if wheels with aligning moments move against their headings: these moments hold ahead."""
    n, attitudes, found = system.scene.dimension, None, []
    for item in system.scene.items:
        if item.entry.section != "forces" or item.kind.name != "tyre" or not item.given("aligning_stiffness"):
            continue
        attitudes = Attitudes.of(system) if attitudes is None else attitudes
        body, numbers = place_of(item)
        A, spin = attitudes.orientations(system, q)[body], attitudes.spins(system, q, u)[body]
        point, direction = (A @ np.array(x, dtype=float) for x in (numbers[:n], numbers[n : 2 * n]))
        heading = direction if n == 2 else np.cross(direction, np.array(numbers[-3:], dtype=float))
        turning = np.cross(spin, point) if n == 3 else spin[2] * np.array([-point[1], point[0]])
        start = system.body_slices[body].start
        speed = float(heading @ (u[start : start + n] + turning) / np.linalg.norm(heading))
        if speed < 0.0:
            found.append(f"{item.entry.called} ({speed:.6g} m/s)")
    if not found:
        return []
    key = "along of the tyre" if n == 2 else "axle of the contact"
    return [
        f"aligning moments hold for wheels that move ahead; against their headings move those of {' and '.join(found)}"
        f"\nhint: turn the {key} round, -x for x"
    ]
