"""Explicit integrators as machine code: a scene as the arrays of `mbstab.compiler.machine`, and many steps at once.

The steps are those of `Projected` (`mbstab.analysis.simulate.steppers.explicit`): the same tableau, the same
step control, the same projection except that a change of positions leaves nonholonomic rows unchanged.
Where something unusual happens, a march stops before it and the caller continues step by step.
"""

from __future__ import annotations

import importlib
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.energy import Energy
from mbstab.analysis.simulate.steppers.implicit import first_step, newton_goal
from mbstab.analysis.simulate.steppers.interface import Method, Options
from mbstab.analysis.simulate.steppers.layout import machine_of
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.machine import tables as at
from mbstab.compiler.machine.tables import table
from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError

if TYPE_CHECKING:
    from mbstab.compiler.machine.explicit import Tableau


@cache
def tableau_of(solver: str) -> Tableau:
    """Return an explicit integrator of SciPy, DOP853 or RK45, as arrays."""
    import scipy.integrate

    from mbstab.compiler.machine.explicit import Tableau

    method = getattr(scipy.integrate, solver)
    s, more = method.n_stages, getattr(method, "C_EXTRA", np.zeros(0))
    quadrature = np.array(legendre.leggauss(method.order))
    A = np.zeros((s + 1 + len(more),) * 2)
    A[:s, : method.A.shape[1]] = method.A[:s]
    A[s, :s] = method.B
    C = np.concatenate([method.C[:s], [1.0], more])
    if not len(more):
        return Tableau(A, C, method.E[None], np.ascontiguousarray(method.P.T), s, 0, -1.0 / 5.0, quadrature)
    A[s + 1 :] = method.A_EXTRA
    first, last = np.eye(len(C))[[0, s]]
    W = np.vstack([A[s], first - A[s], 2.0 * A[s] - first - last, method.D])
    return Tableau(A, C, np.stack([method.E5, method.E3]), W, s, 1, -1.0 / 8.0, quadrature)


def machine_code() -> ModuleType:
    """Return `mbstab.compiler.machine.native`.

    Raises
    ------
    UsageError
        If Numba is not installed.
    """
    try:
        import mbstab.compiler.machine.native as native
    except ImportError:
        raise UsageError("compiled steps need Numba\nhint: install it with pip install 'mbstab[fast]'") from None
    return native


def implicit_of(t: float, options: Options) -> at.Implicit:
    """Return the numbers of an implicit method for a march that starts at t (s)."""
    method, fixed = options.method, options.step is not None
    return at.Implicit(
        tol=options.tol,
        rate=options.rate,
        fixed=fixed,
        iterations=TOLERANCES.newton_steps_implicit[fixed],
        goal=newton_goal(options),
        stalled=TOLERANCES.newton_correction_stalled,
        kink=TOLERANCES.kink_offset,
        collapsed=TOLERANCES.step_collapsed,
        begin=t,
        quadrature=np.array(legendre.leggauss(method.order)),
        power=method.exponent,
        consistent=method.compiled == "radau",
    )


def _counted(place: int) -> property:
    return property(lambda self: int(self.march.counts[place]))


def _told(place: int) -> property:
    return property(lambda self: float(self.march.t[place]))


class Marching:
    """An integrator of one scene as machine code, and the state of its march, once it is started.

    Parameters
    ----------
    equations : Constrained
        The scene.
    attitudes : Attitudes
    energy : Energy
    method : Method

    Attributes
    ----------
    machine : Machine
    march : March
        The state, which machine code changes, with that in the tables of the machine.
    t, following, taken : float
        The time reached, the step to try next, and the last one (s).
    work, peak : float
        Work since the start, and the largest kinetic energy after a step (J).
    residual : float
        The largest residual of a row after a step.
    least : float
        Square of the smallest singular value of the rows at the start, in the metric of M.
    steps, rejected, evaluations : int
    found : ndarray, shape (n_t, 2 n_q + 1)
        q, u and the work at the output times, as far as they are `done`: how many.
    """

    t, following, taken, work = (_told(k) for k in (at.TIME, at.FOLLOWING, at.TAKEN, at.WORK))
    peak, residual, least = (_told(k) for k in (at.PEAK, at.RESIDUAL, at.LEAST))
    steps, rejected, evaluations, done = (_counted(k) for k in (at.STEPS, at.REJECTED, at.EVALUATIONS, at.COVERED))

    def __init__(self, equations: Constrained, attitudes: Attitudes, energy: Energy, method: Method) -> None:
        machine_code()
        self._march = importlib.import_module(f"mbstab.compiler.machine.{method.compiled}").march
        self._free = [i for i, _ in attitudes.parts if i not in attitudes.pinned]
        self._sizes, self._fresh, self.n = equations.sizes, True, equations.n
        self._tableau = tableau_of(method.solver) if method.solver else None
        self.machine = machine_of(equations, self._free, attitudes, energy, not self._tableau)
        self._y, self._before = table(self.machine, at.Y), table(self.machine, at.BEFORE)

    def start(
        self,
        system: System,
        t: float,
        q: Array,
        u: Array,
        times: Array,
        end: float,
        options: Options,
        least: float,
        near: float,
    ) -> None:
        """Start at a state.

        Parameters
        ----------
        system : System
            The scene, with any base rotations.
        t : float (s)
        q, u : ndarray, shape (n_q,)
        times : ndarray
            Remaining output times (s).
        end : float (s)
        options : Options
        least : float
            Square of the smallest singular value, in the metric of M, that others are compared with; 0: that here.
        near : float
            Fraction of that singular value below which no compiled steps are taken.
        """
        n, first = self.n, options.step or options.first or 0.0
        bases = [x for i in self._free for x in system.scene.bodies[i].base]
        table(self.machine, at.W)[2 * n + 1 : 2 * n + 1 + len(bases)] = bases
        self._method: Tableau | at.Implicit | None = self._tableau
        if not self._tableau:
            self._method, first = implicit_of(t, options), first_step(options, end - t)
        stages = len(self._tableau.C) if self._tableau else 0
        self._y[:n], self._y[n:] = q, u
        self._before[:] = self._y
        values = {at.TIME: t, at.FOLLOWING: first, at.LEAST: least}
        self.march = at.March(
            k=np.zeros((stages, 2 * n)),
            t=np.array([values.get(place, 0.0) for place in range(at.PLACES)]),
            counts=np.zeros(4, dtype=np.int64),
            absolute=options.tolerances(self._sizes),
            relative=TOLERANCES.step_tolerance_relative,
            longest=options.step or options.longest,
            end=end,
            near=near * near,
            times=np.ascontiguousarray(times, dtype=float),
            found=np.zeros((len(times), 2 * n + 1)),
        )
        self.found, self._fresh = self.march.found, True

    @property
    def q(self) -> Array:
        """Coordinates, shape (n_q,)."""
        return self._y[: self.n].copy()

    @property
    def u(self) -> Array:
        """Speeds, shape (n_q,)."""
        return self._y[self.n :].copy()

    @property
    def before(self) -> Array:
        """Coordinates before the last step."""
        return self._before[: self.n].copy()

    def go(self) -> str:
        """Take a limited number of steps; return why it stopped: ``done``, ``more``, ``chart`` or ``look``."""
        fresh, self._fresh = self._fresh, False
        reason = self._march(self.machine, self._method, self.march, TOLERANCES.compiled_steps, fresh)
        return {at.DONE: "done", at.MORE: "more", at.CHART: "chart"}.get(reason, "look")
