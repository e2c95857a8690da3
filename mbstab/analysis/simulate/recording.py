"""The output of a run: what its steps give at output times, and the quantities derived from them for all at once.

During a run only the polynomials of its steps are evaluated, at output times and at nodes of a quadrature. What is left
to do once a run is known to be the last, the projection onto the constraints and the sum of the work, runs over arrays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from itertools import groupby

import numpy as np
from numpy.polynomial import legendre

from mbstab.analysis.algebra.arrays import Index
from mbstab.analysis.reference.attitude import Attitudes
from mbstab.analysis.reference.efforts import Acted, Placement, efforts, motion_name, moving_joints, unwound
from mbstab.analysis.reference.outputs import Outputs
from mbstab.analysis.reference.reactions import components, reactions
from mbstab.analysis.simulate.balanced import check_balanced
from mbstab.analysis.simulate.constrained import Constrained
from mbstab.analysis.simulate.energy import Energy, antiderivative
from mbstab.analysis.simulate.many_states import chunks, found_at, settled
from mbstab.analysis.simulate.steppers.interface import Stepper
from mbstab.analysis.simulate.tolerances import TOLERANCES
from mbstab.compiler.system import Array, System
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
class Nodes:
    """States at the nodes of a quadrature over successive steps, and where output times lie.

    Attributes
    ----------
    times : ndarray, shape (n_s, n_p) (s)
        n_p nodes in each of n_s steps.
    q, u : ndarray, shape (n_s, n_p, n_q)
    halves : ndarray, shape (n_s,) (s)
        Half the lengths of the steps.
    step : ndarray of int, shape (n_t,)
        The step that contains an output time, and in `place` where: −1 … 1.
    place : ndarray, shape (n_t,)
    """

    times: Array
    q: Array
    u: Array
    halves: Array
    step: Index
    place: Array

    def work(self, energy: Energy, equations: Constrained) -> tuple[Array, float]:
        """Return the work since the first step at the output times, shape (n_t,), and that of all steps (J)."""
        count, nodes = self.times.shape
        times, q, u = self.times.ravel(), *(x.reshape(count * nodes, -1) for x in (self.q, self.u))
        power = [energy.power(equations, times[k], q[k], u[k]) for k in chunks(equations.system, len(times))]
        series = np.concatenate(power).reshape(count, nodes) @ antiderivative(nodes)[1].T * self.halves[:, None]
        # Legendre polynomials are 1 at the end of a step.
        ends = np.concatenate([[0.0], np.cumsum(np.sum(series, axis=1))])
        within = np.sum(legendre.legvander(self.place, nodes) * series[self.step], axis=1)
        return ends[self.step] + within, float(ends[-1])


@dataclass(frozen=True)
class Stretch:
    """The motion at output times in one frame.

    Attributes
    ----------
    times : ndarray, shape (n_t,) (s)
    q, u : ndarray, shape (n_t, n_q)
        In the angles of the frame.
    work : ndarray, shape (n_t,) (J)
        Since the start of the stretch; once it is settled, since the start of the run.
    done : float (J)
        Work in the whole stretch.
    a : ndarray, shape (n_t, n_q), optional
        Accelerations where the constraints do not determine them.
    nodes : Nodes, optional
        Tell the work later; until then it is 0.
    settled : bool
        Whether states are on the constraints.
    """

    frame: Frame
    times: Array
    q: Array
    u: Array
    work: Array
    done: float = 0.0
    a: Array | None = None
    nodes: Nodes | None = None
    settled: bool = True

    def with_work(self, energy: Energy) -> Stretch:
        """Return the same with its work."""
        if self.nodes is None:
            return self
        work, done = self.nodes.work(energy, self.frame.equations)
        return replace(self, work=work, done=done, nodes=None)

    def on_constraints(self, before: float) -> Iterator[Stretch]:
        """Yield settled parts, after some work (J)."""
        if self.settled:
            yield replace(self, work=before + self.work)
            return
        start = 0
        for times, q, u in settled(self.frame.equations, self.times, self.q, self.u):
            stop = start + len(times)
            yield Stretch(self.frame, times, q, u, before + self.work[start:stop])
            start = stop


class Recorder:
    """Collects the output of a run, step by step.

    Parameters
    ----------
    stretches : list of Stretch
        Filled in the order of time.
    energy : Energy
    nodes : int
        Number of nodes of the quadrature of the power over a step; 0 if there is no work.

    Attributes
    ----------
    works : bool
        Whether there is work.
    """

    def __init__(self, stretches: list[Stretch], energy: Energy, nodes: int) -> None:
        self.stretches, self.energy = stretches, energy
        self.frame: Frame | None = None
        self.works, self._places = nodes > 0, antiderivative(nodes)[0] if nodes else np.zeros(0)
        self._steps: list[tuple[int, float, float]] = []
        self._states: list[tuple[Array, Array, Array]] = []
        self._numbers = 0

    def in_frame(self, frame: Frame) -> None:
        """Continue in another frame."""
        self.close()
        self.frame = frame

    def take(self, stepper: Stepper, start: float, inside: Array) -> None:
        """Take what is needed of the last step of a stepper, which began at a time (s) and contains output times."""
        half = 0.5 * (stepper.t - start)
        times = np.concatenate([inside, start + half * (1.0 + self._places)])
        if not len(times):
            return
        q, u = stepper.at(times)
        self._steps.append((len(inside), start, half))
        self._states.append((times, q, u))
        self._numbers += 2 * q.size
        if self._numbers > TOLERANCES.numbers_of_output and self.works:
            self.close(summed=True)

    def add(self, times: Array, q: Array, u: Array, work: Array, done: float, a: Array | None = None) -> None:
        """Add states that are settled, and their work since the last ones."""
        self.close()
        assert self.frame is not None
        self.stretches.append(Stretch(self.frame, times, q, u, work, done, a))

    def close(self, summed: bool = False) -> None:
        """End a stretch, and sum its work at once if it should be."""
        if not self._steps:
            return
        assert self.frame is not None
        counts, starts, halves = (np.array(x) for x in zip(*self._steps, strict=True))
        whole = [np.concatenate(x) for x in zip(*self._states, strict=True)]
        self._steps, self._states, self._numbers = [], [], 0
        # The output times of a step stand before its nodes.
        p = len(self._places)
        step = np.repeat(np.arange(len(counts)), counts)
        at_nodes = np.zeros(len(whole[0]), dtype=bool)
        at_nodes[(np.cumsum(counts + p)[:, None] - np.arange(p, 0, -1)).ravel()] = True
        times, q, u = (x[~at_nodes] for x in whole)
        nodes = None
        if p:
            t, x, v = (x[at_nodes].reshape(len(counts), p, *x.shape[1:]) for x in whole)
            nodes = Nodes(t, x, v, halves, step, (times - starts[step]) / halves[step] - 1.0)
        found = Stretch(self.frame, times, q, u, np.zeros(len(times)), nodes=nodes, settled=False)
        self.stretches.append(found.with_work(self.energy) if summed else found)


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
    states : ndarray, shape (n_t, n_s)
        First-order states.
    """

    positions: Array
    velocities: Array
    rotations: Array
    spins: Array
    states: Array

    @classmethod
    def of(cls, stretches: Sequence[Stretch]) -> Track:
        """Return the track of at least one stretch."""
        parts = []
        for stretch in stretches:
            system, attitudes, q, u = stretch.frame.system, stretch.frame.attitudes, stretch.q, stretch.u
            d = system.scene.dimension
            places, speeds = (
                np.stack([x[:, part.start : part.start + d] for part in system.body_slices], axis=1) for x in (q, u)
            )
            turns, spins = attitudes.orientations(system, q), attitudes.spins(system, q, u)
            parts.append((places, speeds, turns, spins, q[:, system.states[0]]))
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
    measured : dict of ndarray, shape (n_t,)
        Measures in outputs, as of `mbstab.analysis.reference.outputs.Outputs.measured`.
    outputs : ndarray, shape (n_t, n_o)
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
    measured: dict[str, Array]
    outputs: Array
    motions: Array
    motion_rates: Array
    kinetic: Array
    potential: Array
    residuals: Array

    @classmethod
    def of(cls, stretches: Sequence[Stretch]) -> Record:
        """Return the record of at least one settled stretch; if the user interrupts, that of the first ones."""
        parts: list[Record] = []
        begin = stretches[0].frame.start
        try:
            for stretch in stretches:
                for k in chunks(stretch.frame.system, len(stretch.times)):
                    parts.append(cls._part(stretch, k, begin))
                    begin = parts[-1].q[-1]
        except KeyboardInterrupt:
            if not parts:
                raise
        # A reaction that vanishes exactly in a part of the run may be missing there.
        labels = dict.fromkeys(label for part in parts for label in part.loads)
        loads = {x: np.concatenate([part.loads.get(x, np.zeros(len(part.q))) for part in parts]) for x in labels}
        driving = {x: np.concatenate([part.efforts[x] for part in parts]) for x in parts[0].efforts}
        measured = {x: np.concatenate([part.measured[x] for part in parts]) for x in parts[0].measured}
        names = [field.name for field in fields(cls) if field.name not in ("loads", "efforts", "measured", "outputs")]
        whole = {x: np.concatenate([getattr(part, x) for part in parts]) for x in names}
        scene, times = stretches[0].frame.system.scene, np.concatenate([x.times for x in stretches])[: len(whole["q"])]
        for i, (motion, _) in enumerate(moving_joints(scene)):
            if motion == "angle" and scene.dimension == 3:
                whole["motions"][:, i] = unwound(whole["motions"][:, i], whole["motion_rates"][:, i], times)
        for i, (motion, joint) in enumerate(moving_joints(scene)):
            if (name := motion_name(motion, joint.name)) in measured:
                # From its first value on, which counts turns as the forces do.
                turns = np.round((measured[name][0] - whole["motions"][0, i]) / (2.0 * np.pi))
                whole["motions"][:, i] += 2.0 * np.pi * turns if motion == "angle" else 0.0
                measured[name] = whole["motions"][:, i]
        acted = [Acted(owner, "", unit, x) for (owner, unit), x in driving.items()]
        attitudes = stretches[0].frame.attitudes
        outputs = Outputs(attitudes.file).values(measured, whole["q"], whole["u"], whole["a"], loads, acted)
        return cls(loads=loads, efforts=driving, measured=measured, outputs=outputs, **whole)

    @classmethod
    def _part(cls, stretch: Stretch, k: slice, before: Array) -> Record:
        frame, system, times, q, u = stretch.frame, stretch.frame.system, stretch.times[k], stretch.q[k], stretch.u[k]
        given = None if stretch.a is None else stretch.a[k]
        a, nu, J, kinetic, residuals = found_at(frame.equations, times, q, u, given)
        check_balanced(system, times, q, u, a, nu)
        loads = components(reactions(system, q, u, J, nu))
        at = Placement(frame.attitudes, system, q, u)
        driving = {(acted.owner, acted.unit): acted.values for acted in efforts(at, nu, times)}
        moving = moving_joints(system.scene)
        motions = np.array([at.motion(*x) for x in moving]).reshape(len(moving), len(q)).T
        motion_rates = np.array([at.rate(*x) for x in moving]).reshape(len(moving), len(q)).T
        measured = Outputs(frame.attitudes.file).measured(system, q, u, a)
        shown = _continued(frame, q, before)
        potential = system.potential(q)
        q, u, a = frame.attitudes.in_file(system, q, u, a, shown)
        outputs = np.zeros((len(q), 0))
        return cls(q, u, a, nu, loads, driving, measured, outputs, motions, motion_rates, kinetic, potential, residuals)


def states(stretches: Sequence[Stretch]) -> tuple[Array, Array]:
    """Return q and u of at least one stretch in the angles of the file, each of shape (n_t, n_q)."""
    begin, found = stretches[0].frame.start, []
    for x in stretches:
        shown = _continued(x.frame, x.q, begin)
        found.append(x.frame.attitudes.in_file(x.frame.system, x.q, x.u, np.zeros_like(x.u), shown)[:2])
        begin = shown[-1]
    q, u = (np.concatenate(part) for part in zip(*found, strict=True))
    return q, u


def joined(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Return settled stretches, those of one frame that follow each other as one."""
    found = []
    for (_, given), group in groupby(stretches, lambda x: (id(x.frame), x.a is not None)):
        parts = list(group)
        times, q, u, work = (np.concatenate([getattr(x, name) for x in parts]) for name in ("times", "q", "u", "work"))
        a = np.concatenate([x.a for x in parts if x.a is not None]) if given else None
        if len(times):
            found.append(Stretch(parts[0].frame, times, q, u, work, a=a))
    return found


def _continued(frame: Frame, q: Array, before: Array) -> Array:
    """Return coordinates in the angles of the file, each nearest to the previous ones."""
    if frame.system is frame.attitudes.file:
        return q
    shown = np.empty_like(q)
    for i in range(len(q)):
        before = shown[i] = frame.attitudes.coordinates_in_file(frame.system, q[i], before)
    return shown
