"""The reference motion that a model file asks for: given, at rest, steady, or to be found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbstab.analysis.algebra.sparse import large
from mbstab.analysis.reference.motion import Finder, Motion
from mbstab.analysis.reference.steady import declared_family, detected
from mbstab.compiler.system import System


def reference_motion(system: System, massless: bool = False) -> Motion:
    """Return the reference motion of a scene.

    Parameters
    ----------
    system : System
    massless : bool
        Whether motions without mass are allowed; then the caller determines what forces make of them
        (`mbstab.analysis.linear.massless`).

    Raises
    ------
    ModelFileError
        If the reference does not satisfy the constraints or the equations of motion; names the
        joint or the body and the residual.
    ConstraintError
        If the rank of the constraints cannot be decided.
    MassError
        If a motion that nothing prevents has no mass.
    EquilibriumError
        If a requested equilibrium or steady motion is not found.
    """
    scene = system.scene
    if scene.model.reference.find is not None:
        from mbstab.analysis.reference.equilibrium import found_motion

        return found_motion(system, massless)
    finder = Finder(system, massless)
    q = finder.coordinates()
    if scene.steady is not None:
        family, known = declared_family(system)
        generator, state = finder.steady_rates(q, family, known)
        return finder.motion(q, generator.field(q), steady=generator, declared=True, state=state)
    u, state = finder.rates(q)
    if scene.period is not None:
        return finder.motion(q, u, state=state)
    generators = detected(system, q, u, finder.sizes)
    if not np.any(u):
        return finder.motion(q, u, steady=generators[0], state=state)
    return replace(finder.motion(q, u, state=state), generators=tuple(generators))


def fits_sparse(system: System) -> bool:
    """Return whether a scene is large and sparse matrices can serve: its reference at rest, no rows on speeds."""
    scene = system.scene
    moving = scene.steady is not None or scene.period is not None or any(scene.rates.values())
    return large(system) and not (moving or scene.timed or system.n_n or scene.model.reference.find is not None)
