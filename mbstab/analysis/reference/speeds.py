"""Speeds with which rows hold, at one point or at many points of a sweep."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.algebra.arrays import Index, norms
from mbstab.analysis.algebra.rank import inverse_of_part
from mbstab.analysis.algebra.sparse import dense
from mbstab.analysis.algebra.stacks import times, under
from mbstab.analysis.reference.equations import joined
from mbstab.analysis.reference.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System


def on_rows(
    system: System, q: Array, start: Array, basis: Array, sizes: Array, given: tuple[Index, Array], time: Any = None
) -> tuple[Array, Array]:
    """Return x for which speeds start + basis x satisfy rows and given rates: Gauss-Newton steps of minimum norm.

    Parameters
    ----------
    q, start : ndarray, shape (…, n_q)
    basis : ndarray, shape (…, n_q, k)
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate.
    given : tuple of ndarray, shapes (m,) and (…, m)
        Numbers of coordinates whose rates are given, and these.
    time : float (s), optional

    Returns
    -------
    x : ndarray, shape (…, k)
    slope : ndarray, shape (…, rows, k)
        How rows and given rates, in units of their lengths, depend on x.
    """
    (columns, rates), x, before = given, np.zeros((*q.shape[:-1], basis.shape[-1])), np.asarray(np.inf)
    for _ in range(TOLERANCES.newton_steps_onto_constraints):
        u = start + times(basis, x)
        state = system.dynamics(q, u, time)
        J = dense(state.J)
        lengths = joined([norms(J * sizes), sizes[columns]], 1)
        slope = under(J @ basis, basis[..., columns, :]) / lengths[..., None]
        residual = joined([state.V, u[..., columns] - rates], 1) / lengths
        if not np.any(residual):
            break
        step = -times(inverse_of_part(slope), residual)
        x = x + step
        longest, fastest = (np.max(np.abs(v / sizes), axis=-1, initial=1e-300) for v in (times(basis, step), u))
        # Rows may be nonlinear in the rates. Short steps that do not become shorter any more are rounding.
        settled = (longest < TOLERANCES.newton_step_settled * fastest) & (longest >= before)
        if np.all(settled | ~(longest > 1e-15 * fastest)):
            break
        before = longest
    return x, slope
