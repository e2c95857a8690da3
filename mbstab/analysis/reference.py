"""The reference motion that a model file asks for: given, at rest, steady, or to be found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.analysis.motion import Finder, Motion
from mbstab.analysis.steady import Family, detected, spinning_columns
from mbstab.compiler.system import System


def reference_motion(system: System) -> Motion:
    """Return the reference motion of a scene.

    Raises
    ------
    ModelFileError
        If the reference satisfies the constraints or the equations of motion not, names the
        joint or the body and the residual.
    ConstraintError
        If the rank of the constraints cannot be decided.
    MassError
        If a motion that nothing holds has no mass.
    EquilibriumError
        If an equilibrium or a steady motion that is asked for is not found.
    """
    scene = system.scene
    if scene.model.reference.find is not None:
        from mbstab.analysis.equilibrium import found_motion

        return found_motion(system)
    finder = Finder(system)
    q = finder.coordinates()
    if scene.steady is not None:
        family, known = declared_family(system)
        generator = finder.steady_rates(q, family, known)
        return finder.motion(q, generator.field(q), steady=generator, declared=True)
    u = finder.rates(q)
    if scene.period is not None:
        return finder.motion(q, u)
    generators = detected(system, q, u, finder.sizes)
    if not np.any(u):
        return finder.motion(q, u, steady=generators[0])
    return replace(finder.motion(q, u), generators=tuple(generators))


def declared_family(system: System) -> tuple[Family, dict[int, Any]]:
    """Return the steady motions that the file allows, and the coefficients it gives (arrays in a sweep)."""
    steady, d = system.scene.steady, system.scene.dimension
    if steady is None:
        return Family(system, None, np.zeros(3), np.zeros((0, 3)), ()), {}
    axis = None if steady.axis is None else np.array(steady.axis, dtype=float)
    point = np.zeros(3)
    point[:d] = steady.point
    directions = np.zeros((0, 3))
    if steady.direction is not None:
        directions = np.zeros((1, 3))
        directions[0, :d] = steady.direction
    family = Family(system, axis, point, directions, spinning_columns(system))
    given = ([steady.rate] if axis is not None else []) + ([steady.speed] if len(directions) else [])
    return family, {k: x for k, x in enumerate(given) if x is not None}
