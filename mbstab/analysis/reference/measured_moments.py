"""Moments of inertia that no body can have, taken as measured: whether a motion depends on what is wrong with them."""

from __future__ import annotations

import numpy as np

from mbstab.analysis.reference.rotation import orientation, rate_matrix
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.model.values import principal_moments


def measured_moments(system: System, q: Array, u: Array, allowed: Array) -> list[str]:
    """Return a warning for each body with measured moments, one of which exceeds the sum of the other two.

    The tensor I belongs to a body if and only if its second moments ½ tr(I) 1 − I have no negative eigenvalue. A motion
    that turns the body about axes of one plane only, its own spin included, has the same linearized equations with any
    other moment about the normal of the plane; about one axis only, with any moments across it.

    Parameters
    ----------
    q, u : ndarray, shape (n_q,)
    allowed : ndarray, shape (n_q, …)
        Velocities that the holonomic rows allow.
    """
    warnings = []
    for entry, body, own in zip(
        system.scene.model.bodies.values(), system.scene.bodies, system.body_slices, strict=True
    ):
        if not entry.values.get("measured"):
            continue
        low, middle, high = principal_moments(body.inertia)
        if low + middle >= high:
            continue
        part = slice(own.start + 3, own.stop)
        turning = np.column_stack([allowed[part], u[part]])
        across = orientation(body, q[part]).T @ rate_matrix(body, q[part]) @ turning
        axes, sizes, _ = np.linalg.svd(across / max(np.abs(across).max(initial=0.0), 1e-300))
        number = int(np.sum(sizes > TOLERANCES.turning_axes))
        xx, yy, zz, xy, xz, yz = body.inertia
        tensor = axes.T @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axes
        if number < 2:
            felt = "the motion asked about turns it about one axis at most, and does not depend on the others"
        elif number == 2 and _is_possible_in_plane(tensor):
            felt = "the motion asked about depends on those in one plane only, which a body can have"
        else:
            felt = "the motion asked about depends on them: what is found holds for these numbers, and for no body"
        shown = ", ".join(f"{x:g}" for x in (low, middle, high))
        warnings.append(
            f"{entry.called}: the measured principal moments {shown} kg*m^2 are impossible, the largest exceeds the "
            f"sum of the others by {high - low - middle:.2g} kg*m^2; {felt}"
        )
    return warnings


def _is_possible_in_plane(tensor: Array) -> bool:
    """Whether a body has the moments and products of a tensor but for the moment about its third axis.

    The least eigenvalue of the second moments is a concave function of that moment.
    """
    from scipy.optimize import minimize_scalar

    most = float(tensor[0, 0] + tensor[1, 1])

    def least(moment: float) -> float:
        changed = tensor.copy()
        changed[2, 2] = moment
        return float(np.linalg.eigvalsh(0.5 * np.trace(changed) * np.eye(3) - changed)[0])

    best = minimize_scalar(lambda x: -least(x), bounds=(0.0, most), method="bounded")
    return bool(-best.fun >= -TOLERANCES.turning_axes * most)
