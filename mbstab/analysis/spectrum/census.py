"""The number of eigenvalues right of the imaginary axis, counted without computing them.

At rest, with R = D + G split into its symmetric and its skew part, K symmetric, all restricted to the motions that the
constraints allow, and n₋ the number of negative squares of K:

* D ≥ 0, G = 0: n₋ eigenvalues lie right of the axis, and if D > 0 and K is regular all others left of it. (With
  D + εM in place of D none lies on the axis. If one approaches it for ε → 0, its vector x has Dx = 0, and it comes
  from the left: s² + εs + ω² = 0.)
* D > 0, any G: the same (Kelvin, Tait, Chetaev; Zajac 1964, J. Astronaut. Sci. 11; Müller 1977, *Stabilität und
  Matrizen*).
* D ≥ 0, any G, n₋ = 0: none; n₋ odd and K regular: at least one, as det Q(s) changes its sign between 0 and ∞.

Whether K is symmetric and D not negative is decided for each element by itself, never for the sums. n₋ comes from the
inertia of a sparse factorization (`mbstab.analysis.algebra.inertia`). In all other cases the zeros of the determinant
are counted by its winding number (`mbstab.analysis.spectrum.winding`).
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.algebra.ball_arrays import BALLS
from mbstab.analysis.algebra.tolerances import TOLERANCES as ALGEBRA
from mbstab.analysis.linear.sparse_equations import SparseEquations
from mbstab.analysis.reference.rounded_scene import exact_system
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.spectrum.winding import winding
from mbstab.analysis.verdict.drag import Drag
from mbstab.analysis.verdict.rule import Census
from mbstab.analysis.verdict.work import acts_symmetrically
from mbstab.compiler.system import Array, System
from mbstab.errors import counted
from mbstab.records import dataclass


@dataclass(frozen=True)
class Resting:
    """Properties of the linearized equations of a scene at rest that follow from its elements.

    Attributes
    ----------
    why_not : str
        Why the stiffness is not known to be symmetric or the damping to be nonnegative; empty: they are.
    damped, gyroscopic : bool
        Whether R has a symmetric part, and a skew part.
    stored : bool
        Whether all forces have potentials but for what takes energy: the energy never increases.
    resisting : frozenset of str
        The paths of written forces of which only that is known, not that they are smooth.
    """

    why_not: str = ""
    damped: bool = False
    gyroscopic: bool = False
    stored: bool = True
    resisting: frozenset[str] = frozenset()

    @property
    def conservative(self) -> bool:
        """Whether squares of eigenvalues are real: K is symmetric and R zero."""
        return not self.why_not and not self.damped and not self.gyroscopic

    @property
    def symmetric(self) -> bool:
        """Whether M, R and K are symmetric."""
        return not self.why_not and not self.gyroscopic


def resting(system: System, q: Array, time: float, n_nonholonomic: int) -> Resting:
    """Return the properties of the linearized equations at rest that follow from the elements.

    Parameters
    ----------
    system : System
    q : ndarray, shape (n_q,)
    time : float (s)
    n_nonholonomic : int
        Number of rows on speeds.
    """
    if n_nonholonomic:
        return Resting(f"{counted(n_nonholonomic, 'row')} on speeds alone", stored=False)
    damped = gyroscopic = False
    stored, resisting, drag = True, set[str](), Drag(system, q, time)
    place = BALLS.of(q).tolist()
    for element, exact in zip(system.acting(), exact_system(system).acting(), strict=True):
        if element.inertia:
            continue
        if element.stored:
            damped = damped or element.damped
            continue
        if element.written and drag.potential(element.path) and np.all(drag.resists(element.path)):
            resisting.add(element.path)
        else:
            stored = False
        found = acts_symmetrically(exact, place, time)
        if found is None:
            return Resting(f"{element.path} has no symmetric stiffness or may drive the motion", stored=False)
        damped, gyroscopic = damped or found[0], gyroscopic or found[1]
    return Resting("", damped, gyroscopic, stored, frozenset(resisting))


def census(equations: SparseEquations, at_rest: Resting | None) -> Census:
    """Return the number of eigenvalues right of the imaginary axis.

    Parameters
    ----------
    equations : SparseEquations
    at_rest : Resting or None
        None: the reference moves.
    """
    if at_rest is None or at_rest.why_not:
        return winding(equations, "the reference moves" if at_rest is None else at_rest.why_not)
    m, forms = equations.matrices, equations.forms
    K = 0.5 * (m.K + m.K.T)
    below, zeros = forms.negatives(K, equations.unsure), 0
    if below is None:
        for part in TOLERANCES.square_rate_zero:
            band = part * equations.rate**2
            unsure = equations.unsure + (ALGEBRA.entry_rounding * band) * equations.sizes.M
            low, high = (forms.negatives(K + x * m.M, unsure) for x in (band, -band))
            if low is not None and high is not None:
                below, zeros = low, high - low
                break
    if below is None:
        return Census(None, how="the inertia of the stiffness cannot be told in double precision")
    D = 0.5 * (m.R + m.R.T)
    dissipative = at_rest.damped and forms.negatives(D, ALGEBRA.entry_rounding * equations.sizes.R) == 0
    if at_rest.gyroscopic and not dissipative and below:
        text = "with gyroscopic forces and damping that does not reach all motions, the stiffness does not count them"
        return Census(None, least=0 if zeros else below % 2, zeros=zeros, how=text)
    how = "by the inertia of the stiffness on the motions that the constraints allow"
    if at_rest.damped or at_rest.gyroscopic:
        how += " (Kelvin, Tait, Chetaev)"
    unexplained = zeros - len(equations.neutral) if zeros else 0
    if unexplained > 0:
        text = f"{counted(unexplained, 'square')} of the stiffness cannot be told from zero"
        return Census(None, least=below, zeros=zeros, how=f"{how}, but {text}" if below else text)
    return Census(below, least=below, zeros=zeros, left=dissipative and not zeros and not below, how=how)
