"""Which outputs can respond to which inputs, by the entries of the equations that are exactly zero.

With a variable for each row of s E − A, so that the entries on the diagonal are not zero, an entry (i, k) of the
inverse is zero for all s unless a path of entries leads from i to k (Duff, Erisman and Reid, Direct Methods for Sparse
Matrices, 2nd ed., Oxford 2017, ch. 15).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mbstab.analysis.response.descriptor import Unreduced
from mbstab.analysis.response.state_space import ControlModel


def responding(model: ControlModel | Unreduced) -> Any:
    """Return whether outputs may respond to inputs, shape (outputs, inputs); where it is False the response is 0."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching

    found = model.descriptor
    direct = np.zeros((len(found.C), found.B.shape[1]), dtype=bool)
    for column, (own, _) in enumerate(model.orders):
        direct[:, own] |= found.D[:, column] != 0.0
    pattern = csr_array((found.E != 0.0) | (found.A != 0.0))
    own = maximum_bipartite_matching(pattern, perm_type="column")
    if model.linear.motion.redundant or np.any(own < 0):
        # The inverse does not exist, or is not known to.
        return np.ones_like(direct)
    leads = pattern[:, own].astype(int)
    moved = found.B != 0.0
    while np.any(more := (leads @ moved.astype(int) > 0) & ~moved):
        moved |= more
    responds: Any = direct | ((found.C[:, own] != 0.0).astype(int) @ moved.astype(int) > 0)
    return responds
