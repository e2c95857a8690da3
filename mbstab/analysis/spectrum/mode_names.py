"""Names of modes from the file, found among the modes at one point.

A mode is found by its eigenvalue, or by its shape: the motion of least kinetic energy with the given amplitudes is
compared with each mode by the modal assurance criterion, |xᴴMy|²/((xᴴMx)(yᴴMy)) with the mass matrix M (Allemang 2003,
Sound and Vibration 37(8)). Each name belongs to at most one mode, and each mode has at most one name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mbstab.analysis.algebra.arrays import Complex
from mbstab.analysis.algebra.matching import assigned
from mbstab.analysis.linear.linearize import Linearization
from mbstab.analysis.spectrum.named_motions import NamedMotions
from mbstab.analysis.spectrum.results import EigenResult, Eigenvalue
from mbstab.analysis.spectrum.tolerances import TOLERANCES
from mbstab.analysis.verdict.wording import show
from mbstab.compiler.system import Array
from mbstab.errors import ModelFileError
from mbstab.model.schema import ModeName
from mbstab.records import dataclass


@dataclass(frozen=True)
class Found:
    """Named modes at one point.

    Attributes
    ----------
    values : dict
        The eigenvalue of each mode that is found, of a pair the upper one (1/s).
    notes : tuple of str
        What is ambiguous or not found.
    """

    values: dict[str, complex]
    notes: tuple[str, ...]


def find_modes(linear: Callable[[], Linearization], result: EigenResult, names: Sequence[ModeName]) -> Found:
    """Find the modes that names stand for among those of a result.

    The linearization is asked for only where a mode is given by its shape.

    Raises
    ------
    ModelFileError
        If the constraints do not allow a shape.
    """
    modes = [e for e in result.eigenvalues if e.vector is not None and e.value.imag >= 0.0]
    if not modes or not names:
        return Found({}, tuple(f"{mode.called} is not found: no mode has a shape" for mode in names))
    count = len(result.eigenvalues)
    cost = np.array([_differences(linear, modes, mode) for mode in names])
    square = np.full((max(cost.shape),) * 2, 1.0)
    square[: cost.shape[0], : cost.shape[1]] = np.minimum(cost, 1.0)
    values, notes = {}, list[str]()
    for mode, row, chosen in zip(names, cost, assigned(square), strict=False):
        best = float(row[chosen]) if chosen < len(modes) else 1.0
        if best > TOLERANCES.mode_difference:
            what = "similar to its shape" if mode.near is None else f"near {show(mode.near)}"
            among = f" of the {count} eigenvalues that were computed" if count < result.counts.expected else ""
            notes.append(f"{mode.called} is not found: no mode{among} is {what}")
            continue
        values[mode.name] = modes[chosen].value
        rivals = [i for i in range(len(modes)) if i != chosen and row[i] <= best + TOLERANCES.mode_ambiguous]
        if rivals:
            others = ", ".join(show(modes[i].value) for i in rivals)
            notes.append(
                f"{mode.called} is ambiguous: {show(modes[chosen].value)} was chosen, but {others} fits as well"
            )
    return Found(values, tuple(notes))


def _differences(linear: Callable[[], Linearization], modes: Sequence[Eigenvalue], mode: ModeName) -> Array:
    """Return by how much each mode differs from a named one, 0 to 1."""
    if mode.near is not None:
        near = complex(mode.near.real, abs(mode.near.imag))
        far = np.array([abs(e.value - near) for e in modes])
        size = max([abs(near), *(abs(e.value) for e in modes)])
        return np.asarray(far / (far + TOLERANCES.mode_near * (abs(near) or size)))
    here = linear()
    shape = reference_shape(here, mode)
    return np.array([1.0 - mac(here.M, shape, e.vector) for e in modes if e.vector is not None])


def mac(M: Array, x: Complex, y: Complex) -> float:
    """Return the modal assurance criterion of two shapes, 0 to 1; in either phase of a conjugate pair."""
    sizes = float(np.real(x.conj() @ (M @ x)) * np.real(y.conj() @ (M @ y)))
    if not sizes > 0.0:
        return 0.0
    return max(abs(complex(x.conj() @ (M @ z))) ** 2 for z in (y, y.conj())) / sizes


def reference_shape(linear: Linearization, mode: ModeName) -> Complex:
    """Return the allowed motion of least kinetic energy with given amplitudes, shape (n_q,).

    Raises
    ------
    ModelFileError
        If the constraints do not allow it.
    """
    motion, system = linear.motion, linear.system
    named = NamedMotions.of(system, motion.q, motion.sizes)
    number = {name: i for i, name in enumerate(named.names)}
    chosen = [number[name] for name in mode.shape]
    N = linear.spaces.scale[:, None] * linear.spaces.N
    rows = (named.rows[chosen] @ N) / named.sizes[chosen, None]
    goal = np.array([*mode.shape.values()]) / named.sizes[chosen]
    inertia = np.asarray(N.T @ (linear.M @ N))
    inertia = inertia + TOLERANCES.mode_massless * float(np.trace(inertia)) / max(len(inertia), 1) * np.eye(
        len(inertia)
    )
    compliance = np.linalg.solve(inertia, rows.T)
    x = compliance @ (np.linalg.pinv(rows @ compliance, rcond=TOLERANCES.mode_massless) @ goal)
    off = np.abs(rows @ x - goal)
    if np.max(off, initial=0.0) > TOLERANCES.mode_held * np.max(np.abs(goal)):
        worst, path = [*mode.shape][int(np.argmax(off))], f"modes.{mode.name}.shape"
        message = f"the constraints do not allow this shape: {worst} does not move like that with the others"
        hint = "leave it out, or give it the amplitude that follows from the others"
        raise ModelFileError([system.scene.model.document.problem(mode.location, path, message, hint)])
    return np.asarray(N @ x, dtype=complex)
