"""The samples of a run, and the quantities derived from them for all output times at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from itertools import groupby

import numpy as np

from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Placement, efforts, moving_joints, unwound
from mbstab.analysis.reference.reactions import reactions
from mbstab.analysis.simulate.balanced import check_balanced
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, Dynamics, System
from mbstab.records import dataclass


@dataclass(frozen=True)
class Frame:
    """The common data of the samples between two changes of charts.

    Attributes
    ----------
    start : ndarray, shape (n_q,)
        Coordinates at the start of the run, in the angles of the file.
    """

    equations: Constrained
    attitudes: Attitudes
    start: Array

    @property
    def system(self) -> System:
        """The scene in the angles of this frame."""
        return self.equations.system


@dataclass(frozen=True)
class Sample:
    """The motion at an output time (s): q and u on the constraints, in the angles of the frame; work (J).

    The accelerations are stored where the constraints do not determine them.
    """

    frame: Frame
    t: float
    q: Array
    u: Array
    work: float
    a: Array | None = None


@dataclass(frozen=True)
class Track:
    """Positions and velocities of the bodies.

    Attributes
    ----------
    positions, velocities : ndarray, shape (n_t, n_b, d)
        Positions and velocities of the reference points, in ground axes (m, m/s).
    rotations : ndarray, shape (n_t, n_b, d, d)
        From body axes to ground axes; the identity for point masses.
    spins : ndarray, shape (n_t, n_b, 3)
        Angular velocities in ground axes (rad/s).
    """

    positions: Array
    velocities: Array
    rotations: Array
    spins: Array

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> Track:
        """Return the track of at least one sample."""
        parts = []
        for frame, group in _groups(samples):
            system, attitudes = frame.system, frame.attitudes
            q, u = (np.array([getattr(s, name) for s in group]) for name in "qu")
            d = system.scene.dimension
            places, speeds = (
                np.stack([x[:, part.start : part.start + d] for part in system.body_slices], axis=1) for x in (q, u)
            )
            parts.append((places, speeds, attitudes.orientations(system, q), attitudes.spins(system, q, u)))
        return cls(*(np.concatenate(part) for part in zip(*parts, strict=True)))


@dataclass(frozen=True)
class Record:
    """All other quantities, in the angles of the file.

    Attributes
    ----------
    q, u, a : ndarray, shape (n_t, n_q)
    nu : ndarray, shape (n_t, n_c)
    loads : dict of ndarray, shape (n_t,)
        Reactions (N, N·m) by owner, body acted on, and component such as ``force x``.
    efforts : dict of ndarray, shape (n_t,)
        Efforts of what acts along one motion, by owner and unit (N, N·m).
    motions, motion_rates : ndarray, shape (n_t, n_m)
        Motions of joints, as `mbstab.analysis.reference.efforts.moving_joints` lists them (m, rad).
    kinetic, potential : ndarray, shape (n_t,) (J)
    residuals : ndarray, shape (n_t, 2)
        In position and velocity, as in `Constrained.residuals`.
    """

    q: Array
    u: Array
    a: Array
    nu: Array
    loads: dict[tuple[str, str, str], Array]
    efforts: dict[tuple[str, str], Array]
    motions: Array
    motion_rates: Array
    kinetic: Array
    potential: Array
    residuals: Array

    @classmethod
    def of(cls, samples: Sequence[Sample]) -> Record:
        """Return the record of at least one sample; if the user interrupts, that of the first ones."""
        parts: list[Record] = []
        begin = samples[0].frame.start
        try:
            for frame, group in _groups(samples):
                parts.append(cls._part(frame, group, begin))
                begin = parts[-1].q[-1]
        except KeyboardInterrupt:
            if not parts:
                raise
        # A reaction that vanishes exactly in a part of the run may be missing there.
        labels = dict.fromkeys(label for part in parts for label in part.loads)
        loads = {x: np.concatenate([part.loads.get(x, np.zeros(len(part.q))) for part in parts]) for x in labels}
        driving = {x: np.concatenate([part.efforts[x] for part in parts]) for x in parts[0].efforts}
        names = [field.name for field in fields(cls) if field.name not in ("loads", "efforts")]
        whole = {x: np.concatenate([getattr(part, x) for part in parts]) for x in names}
        scene, times = samples[0].frame.system.scene, np.array([s.t for s in samples[: len(whole["q"])]])
        for i, (motion, _) in enumerate(moving_joints(scene)):
            if motion == "angle" and scene.dimension == 3:
                whole["motions"][:, i] = unwound(whole["motions"][:, i], whole["motion_rates"][:, i], times)
        return cls(loads=loads, efforts=driving, **whole)

    @classmethod
    def _part(cls, frame: Frame, samples: Sequence[Sample], before: Array) -> Record:
        equations, system = frame.equations, frame.system
        q, u = (np.array([getattr(s, name) for s in samples]) for name in "qu")
        times = np.array([s.t for s in samples])
        given = any(sample.a is not None for sample in samples)
        found = None if given or len(samples) < TOLERANCES.states_singly else equations.together(times, q, u)
        a, nu, J, kinetic, residuals = cls._singly(equations, samples) if found is None else _summed(u, *found)
        check_balanced(system, times, q, u, a, nu)
        loads: dict[tuple[str, str, str], Array] = {}
        for r in reactions(system, q, u, J, nu):
            turning = "xyz" if r.torque.shape[-1] == 3 else "z"
            for what, letters, vector in (("force", "xyz", r.force), ("torque", turning, r.torque)):
                loads |= {(r.owner, r.body, f"{what} {x}"): v for x, v in zip(letters, vector.T, strict=False)}
        at = Placement(frame.attitudes, system, q, u)
        driving = {(acted.owner, acted.unit): acted.values for acted in efforts(at, nu, times)}
        moving = moving_joints(system.scene)
        motions = np.array([at.motion(*x) for x in moving]).reshape(len(moving), len(q)).T
        motion_rates = np.array([at.rate(*x) for x in moving]).reshape(len(moving), len(q)).T
        shown = _continued(frame, q, before)
        potential = system.potential(q)
        q, u, a = frame.attitudes.in_file(system, q, u, a, shown)
        return cls(q, u, a, nu, loads, driving, motions, motion_rates, kinetic, potential, residuals)

    @staticmethod
    def _singly(equations: Constrained, samples: Sequence[Sample]) -> tuple[Array, ...]:
        """Return a, ν, J, kinetic energies and residuals."""
        system, count = equations.system, len(samples)
        a, nu, J = (
            np.empty((count, system.n_q)),
            np.empty((count, system.n_c)),
            np.empty((count, system.n_c, system.n_q)),
        )
        kinetic, residuals = np.empty(count), np.empty((count, 2))
        for i, sample in enumerate(samples):
            if sample.a is None:
                a[i], multipliers, state = equations.accelerations(sample.t, sample.q, sample.u)
                nu[i] = equations.least(multipliers)
            else:
                state, a[i] = equations.evaluate(sample.t, sample.q, sample.u), sample.a
                nu[i] = equations.multipliers(state, a[i])
            J[i] = state.J
            kinetic[i] = 0.5 * float(sample.u @ state.M @ sample.u)
            residuals[i] = equations.residuals(state, equations.fastest(sample.u))
        return a, nu, J, kinetic, residuals


def _summed(
    u: Array, a: Array, nu: Array, state: Dynamics, residuals: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return a, ν, J, kinetic energies and residuals at several states."""
    kinetic = 0.5 * (u[:, None, :] @ state.M @ u[:, :, None])[:, 0, 0]
    return a, nu, np.broadcast_to(state.J, (len(u), *state.J.shape[1:])), kinetic, residuals


def states(samples: Sequence[Sample]) -> tuple[Array, Array]:
    """Return q and u of at least one sample in the angles of the file, each of shape (n_t, n_q)."""
    begin, found = samples[0].frame.start, []
    for frame, group in _groups(samples):
        q, u = (np.array([getattr(s, name) for s in group]) for name in "qu")
        shown = _continued(frame, q, begin)
        found.append(frame.attitudes.in_file(frame.system, q, u, np.zeros_like(u), shown)[:2])
        begin = shown[-1]
    q, u = (np.concatenate(part) for part in zip(*found, strict=True))
    return q, u


def _continued(frame: Frame, q: Array, before: Array) -> Array:
    """Return coordinates in the angles of the file, each nearest to the previous ones."""
    shown = np.empty_like(q)
    for i in range(len(q)):
        before = shown[i] = frame.attitudes.coordinates_in_file(frame.system, q[i], before)
    return shown


def _groups(samples: Sequence[Sample]) -> Iterator[tuple[Frame, list[Sample]]]:
    """Yield samples in order, those of one frame together, in groups of limited size."""
    for _, group in groupby(samples, lambda s: id(s.frame)):
        found = list(group)
        system = found[0].frame.system
        count = min(
            TOLERANCES.states_together, 1 + TOLERANCES.matrix_numbers_together // (1 + (system.n_c + system.n_q) ** 2)
        )
        for k in range(0, len(found), count):
            yield found[0].frame, found[k : k + count]
