"""A simulated motion: its recorded quantities and its accuracy."""

from __future__ import annotations

import numpy as np

from mbstab.compiler.system import Array
from mbstab.records import Answer, dataclass


@dataclass(frozen=True, repr=False)
class Simulation(Answer):
    """A motion over a span of time.

    Attributes
    ----------
    names, units, bodies, rows : tuple of str
        Coordinates in the order of q and their units, bodies, constraint rows.
    times : ndarray, shape (n_t,)
        Output times (s).
    q, u, a : ndarray, shape (n_t, n_q)
        Coordinates (m, rad), rates and accelerations, in the angles of the file.
    nu : ndarray, shape (n_t, n_c)
        Multipliers [λ; μ], of minimum norm where rows are redundant.
    positions : ndarray, shape (n_t, n_b, d)
        Reference points of the bodies in ground axes (m), d = 2 or 3.
    rotations : ndarray, shape (n_t, n_b, d, d)
        From body axes to ground axes; the identity for point masses.
    velocities : ndarray, shape (n_t, n_b, d)
        Velocities of the reference points (m/s).
    spins : ndarray, shape (n_t, n_b, 3)
        Angular velocities in ground axes (rad/s); about z in the plane.
    loads : ndarray, shape (n_t, n_l)
        Reactions as in `mbstab.analysis.reference.reactions`: forces (N) and torques (N·m), ground axes.
    load_names : tuple of (str, str, str)
        Owner, body acted on, and component such as ``force x``.
    efforts : ndarray, shape (n_t, n_e)
        Efforts of what acts along one motion (N, N·m), positive in its direction.
    effort_names : tuple of (str, str)
        Owner and unit.
    motions, motion_rates : ndarray, shape (n_t, n_m)
        Angles and displacements of joints (rad, m), and their rates.
    motion_names : tuple of (str, str)
        Such as ``angle(pivot)``, and unit.
    outputs : ndarray, shape (n_t, n_o)
        The outputs of the file; not finite where one has no value.
    output_names : tuple of (str, str)
        Name and unit.
    kinetic, potential : ndarray, shape (n_t,)
        Kinetic energy, and potential energy of gravity and springs (J).
    work : ndarray, shape (n_t,)
        Work of forces without a potential, dampers and drives since the start (J).
    residuals : ndarray, shape (n_t, 2)
        Largest residuals of constraint rows in position and velocity, relative to the sizes in the scene and to
        the speeds at that time.
    method, solver : str
    tol : float
        The requested global error; nan with fixed steps.
    step : float or None
        The fixed step (s).
    error_estimate : float
        Estimate of the global error, the largest of the errors of positions, relative to the size of the scene, of
        entries of rotation matrices, and of speeds, relative to the largest speed of the motion or, where nothing
        moves, to `resting_speed` (`mbstab.analysis.simulate.tolerances`) times the natural rate of the scene; nan
        where only one run was made.
    steps, rejected, evaluations : int
        Counts of the last run; evaluations are those of all runs.
    runs, charts : int
        Number of runs, and of changes of Euler angles in the last one.
    peak : float (J)
        The largest kinetic energy after any step, but at least that of speeds that count as rest.
    sizes : ndarray, shape (n_q,)
        Characteristic size of each coordinate.
    conservative : bool
        Whether nothing does work.
    warnings : tuple of str
    complete : bool
    failure : str
        Why the motion ends early, or empty.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    bodies: tuple[str, ...]
    rows: tuple[str, ...]
    times: Array
    q: Array
    u: Array
    a: Array
    nu: Array
    positions: Array
    rotations: Array
    velocities: Array
    spins: Array
    loads: Array
    load_names: tuple[tuple[str, str, str], ...]
    efforts: Array
    effort_names: tuple[tuple[str, str], ...]
    motions: Array
    motion_rates: Array
    motion_names: tuple[tuple[str, str], ...]
    outputs: Array
    output_names: tuple[tuple[str, str], ...]
    kinetic: Array
    potential: Array
    work: Array
    residuals: Array
    method: str
    solver: str
    tol: float
    step: float | None
    error_estimate: float
    steps: int
    rejected: int
    evaluations: int
    runs: int
    charts: int
    peak: float
    sizes: Array
    conservative: bool
    warnings: tuple[str, ...]
    complete: bool
    failure: str

    def __repr__(self) -> str:
        """Return a summary instead of the long arrays."""
        solver = f" {self.solver}" if self.solver else ""
        return (
            f"<Simulation of {len(self.names)} coordinates at {len(self.times)} times from {self.times[0]:g} to "
            f"{self.times[-1]:g} s by {self.method}{solver}, error estimate {self.error_estimate:.2g}>"
        )

    @property
    def end_state(self) -> dict[str, dict[str, float]]:
        """Coordinates, rates and outputs by name at the last time."""
        q, u = (dict(zip(self.names, x[-1].tolist(), strict=True)) for x in (self.q, self.u))
        return {
            "coordinates": q,
            "rates": u,
            "outputs": {name: x for (name, _), x in zip(self.output_names, self.outputs[-1].tolist(), strict=True)},
        }

    @property
    def max_constraint_residual(self) -> float:
        """The largest relative residual of a constraint row at any output time."""
        return float(np.max(self.residuals, initial=0.0))

    @property
    def imbalance(self) -> Array:
        """Change of T + V − work since the start, shape (n_t,) (J): zero but for errors."""
        total = self.kinetic + self.potential - self.work
        return np.asarray(total - total[0])

    @property
    def energy_scale(self) -> float:
        """The largest energy that is exchanged (J)."""
        swing = float(np.ptp(self.potential))
        return max(self.peak, float(np.max(self.kinetic)), swing, float(np.max(np.abs(self.work))))

    @property
    def energy_drift(self) -> float:
        """The largest imbalance of energy, relative to `energy_scale`; 0 where energies underflow."""
        return float(np.max(np.abs(self.imbalance))) / (self.energy_scale or 1.0)
