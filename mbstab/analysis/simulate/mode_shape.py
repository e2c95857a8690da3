"""A mode of the linearized equations as a motion for display: an oscillation about the reference.

The shape of the mode with its phases, exaggerated, is projected onto the holonomic constraints at every instant. Growth
and decay are not shown. For a steady motion it is shown in the co-moving frame.
"""

from __future__ import annotations

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.start import complex_mode
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
from mbstab.errors import UsageError
from mbstab.model.schema import is_state
from mbstab.records import dataclass


@dataclass(frozen=True)
class Swing:
    """One period of a mode.

    Attributes
    ----------
    value : complex
        Its eigenvalue (1/s).
    q : ndarray, shape (n_t, n_q)
        Coordinates (m, rad).
    positions, rotations : ndarray, shape (n_t, n_b, d) and (n_t, n_b, d, d)
        Positions of the bodies, as in `mbstab.analysis.simulate.result.Simulation`.
    rest : (ndarray, ndarray)
        The same, of shapes (n_b, d) and (n_b, d, d), at the reference.
    """

    value: complex
    q: Array
    positions: Array
    rotations: Array
    rest: tuple[Array, Array]


def swing(system: System, number: int, points: int, amplitude: float = TOLERANCES.swing_amplitude) -> Swing:
    """Return a mode at evenly spaced instants of a period, the first one after its start.

    Parameters
    ----------
    number : int
        Number of the mode in ``mbstab eig``, from 1; a pair is one mode.
    points : int
        Number of instants.
    amplitude : float
        Amplitude of the coordinate of a body that moves most, in sizes of the scene or rad.

    Raises
    ------
    UsageError
        If there is no such mode, it moves no body, or belongs to a periodic motion.
    """
    if system.scene.period is not None:
        raise UsageError("modes of periodic motions have no shape that swings: simulate with --perturb mode:… instead")
    motion = reference_motion(system, massless=True)
    value, dq, _ = complex_mode(system, number)
    moved = np.abs(dq / motion.sizes)
    states = np.ones(len(dq), dtype=bool)
    for p in system.body_slices:
        states[p] = False
    most = int(np.argmax(np.where(states, 0.0, moved)))
    largest = float(moved[most])
    if not largest:
        alone = [name for name, x in zip(system.names, moved, strict=True) if x > 0.0 and is_state(name)]
        message = f"mode {number} moves no body: only {', '.join(alone[:4])}{', …' if len(alone) > 4 else ''}"
        raise UsageError(f"{message}\nhint: mbstab simulate --perturb mode:{number}=0.1 --plot {alone[0]} shows it")
    dq = dq * (np.abs(dq[most]) / dq[most])  # the coordinate that moves most is at its extreme at first
    equations, attitudes = Constrained(system, motion), Attitudes.of(system)
    d, found = system.scene.dimension, []
    for k in range(points):
        phase = np.exp(2j * np.pi * k / points)
        # A real mode swings through the reference: it starts there, not at its amplitude.
        goal = motion.q + amplitude / largest * np.real(dq * phase * (1.0 if value.imag else -1j))
        q, left = equations.onto_positions(motion.time, goal) if equations.n_h else (goal, 0.0)
        found.append(q if left <= TOLERANCES.projection_residual_failed else goal)
    # The last one is the reference itself.
    every = np.array([*found, motion.q])
    positions = np.array([[q[p.start : p.start + d] for p in system.body_slices] for q in every])
    rotations = attitudes.orientations(system, every)
    return Swing(value, every[:-1], positions[:-1], rotations[:-1], (positions[-1], rotations[-1]))
