"""Outputs of a model: what is measured at a state, with its slopes.

A slope is a vector over Δq, Δu, Δa, Δν and, for each input, over w, ẇ and ẅ, one after the other. What joints transmit
follows from their multipliers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbstab.analysis.response.signals import Held, Signals, State, acting_system, slopes
from mbstab.compiler.measured import frames, occurring
from mbstab.compiler.system import Array, System
from mbstab.mechanics.catalogue import GROUND, Effort, ElementUse, Kind, Marker
from mbstab.model.arithmetic import FLOAT
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.model.evaluator import Evaluator
from mbstab.model.jets import Jet
from mbstab.model.measures import TRANSMITTED, Measurement, Places
from mbstab.model.quantities import AXES
from mbstab.model.scene import ItemValues, MeasureNumbers, Scene
from mbstab.model.schema import Entry, Quantity
from mbstab.model.values import joint_measure, measure_numbers

_KIND = Kind("probe", "", (2, 3), (), lambda item: ())


class Meter:
    """Measures at one state.

    Parameters
    ----------
    system : System
    signals : Signals
    at : State
    """

    def __init__(self, system: System, signals: Signals, at: State) -> None:
        self.system, self.signals, self.at = system, signals, at
        n, c = system.n_q, system.n_c
        self.starts = np.cumsum([0, n, n, n, c, *[len(signals.items)] * 3])

    @property
    def size(self) -> int:
        """Length of a slope."""
        return int(self.starts[-1])

    def slope(self, expression: Quantity) -> Array:
        """Return the slope of an output, shape (size,).

        Raises
        ------
        ExpressionError
            If it has no value or no slope here.
        """
        scene = self.system.scene
        expression = scene.rationals.settled(expression)
        names = {
            name: self._constant(lambda s, name=name: s.parameters[name])  # type: ignore[misc]
            if name in scene.parameters
            else self._value(Measurement.of(name))
            for name in expression.names()
        }
        rates = {name: self._value(Measurement.of(name, rate=True)) for name in expression.rates()}
        found = expression.evaluate(names, dual_arithmetic(FLOAT), rates)
        return np.array(np.broadcast_to(found.slope if isinstance(found, Dual) else 0.0, self.size))

    def _vector(self, *parts: tuple[int, Array]) -> Array:
        """Return a slope with the given parts, by their numbers in the order of the module's text."""
        found = np.zeros(self.size)
        for k, values in parts:
            found[self.starts[k] : self.starts[k + 1]] += values
        return found

    def _by_inputs(self, get: Callable[[System], Any]) -> Array:
        """Return the slopes by the inputs of an array of numbers of a system, shape (..., inputs)."""
        parts = [
            slopes(get(self.signals.changed[i])) if i in self.signals.changed else None
            for i in range(len(self.signals.items))
        ]
        shape = next((x.shape for x in parts if x is not None), np.shape(get(self.system)))
        return (
            np.stack([np.zeros(shape) if x is None else x for x in parts], axis=-1) if parts else np.zeros((*shape, 0))
        )

    def _constant(self, get: Callable[[Scene], Any]) -> Dual:
        """Return a number of the scene, with its slopes by the inputs."""
        by = self._by_inputs(lambda system: get(system.scene))
        return Dual(float(get(self.system.scene)), self._vector((4, by)))

    def _value(self, x: Measurement) -> Dual:
        if x.kind == "coordinate":
            i = self.system.names.index(x.arguments[0])
            value = (self.at.q, self.at.u, self.at.a)[x.order][i]
            return Dual(float(value), self._vector((x.order, np.eye(self.system.n_q)[i])))
        if x.kind == "effort":
            return self._effort(x.arguments[0])
        if x.kind in TRANSMITTED:
            return self._transmitted(x)
        found = Places.of(self.system.scene.model).measure(x.axis or x.kind, x.arguments)

        def numbers(scene: Scene) -> MeasureNumbers:
            evaluator = Evaluator(scene.model, scene.parameters, scene.arithmetic)
            return measure_numbers(found, evaluator, lambda name: _item(scene, "joints", name))

        jet = self._measure(f"{found.kind}({', '.join(x.arguments)})", numbers)
        return Dual.of((jet.value, jet.rate, jet.second)[x.order])

    # --- motions ----------------------------------------------------------------------------------------------------

    def _measure(self, name: str, numbers: Callable[[Scene], MeasureNumbers]) -> Jet:
        """Return a measure with its rate and its acceleration; a speed with its own."""
        system, at = self.system, self.at
        n = system.n_q
        one, values = occurring(system.scene, name, numbers(system.scene))

        def given(s: System) -> Any:
            return np.array(occurring(s.scene, name, numbers(s.scene))[1], dtype=object)

        def jet(parts: tuple[Any, ...], first: int, slope: Array) -> Jet:
            return Jet(*(Dual(float(x), self._vector((first + k, slope))) for k, x in enumerate(parts)))

        moving = {
            c: jet((at.q[i], at.u[i], at.a[i]), 0, np.eye(1, n, i)[0])
            for c, i in zip(system.names, range(n), strict=True)
            if any(c in body for body in one.bodies)
        }
        constants = [jet((x, 0.0, 0.0), 4, by) for x, by in zip(values, self._by_inputs(given), strict=True)]
        return Jet.of(one.of(frames(dual_arithmetic(FLOAT), system.scene, moving), iter(constants)))

    def _motion(self, kind: str, joint: str) -> Jet:
        return self._measure(f"{kind}({joint})", lambda scene: joint_measure(kind, _item(scene, "joints", joint)))

    def _entry(self, name: str) -> Entry:
        return Entry("outputs", name, _KIND, {}, self.system.scene.model.reference.location, {})

    # --- forces -----------------------------------------------------------------------------------------------------

    def _effort(self, name: str) -> Dual:
        """Return the effort of a spring, a damper, an actuator or a drive, as `mbstab.analysis.reference.efforts`."""

        def effort(scene: Scene) -> Effort:
            section = "forces" if name in scene.model.entries["forces"] else "drives"
            item = _item(scene, section, name)
            assert item.kind.effort is not None
            return item.kind.effort(item)

        given = effort(self.system.scene)
        if given.driven:
            row = next(i for i, x in enumerate(self.system.rows) if (x.section, x.name) == ("drives", name))
            return Dual(-float(self.at.nu[row]), self._vector((3, -np.eye(self.system.n_c)[row])))
        if given.law is not None:
            return self._constant(lambda scene: effort(scene).law.at(self.at.time).value)
        if given.motion == "distance":
            found = self._measure("distance()", lambda scene: _distance(_item(scene, "forces", given.of.name)))
        else:
            found = self._motion(given.motion, given.of.name)
        x, rate = found.value, found.rate
        stiffness, rest, damping = (
            self._constant(lambda scene, key=key: getattr(effort(scene), key))  # type: ignore[misc]
            for key in ("stiffness", "rest", "damping")
        )
        if given.motion == "angle" and self.system.scene.dimension == 3:
            # The angle within half a turn of the rest.
            x = x - 2.0 * np.pi * round((x.value - rest.value) / (2.0 * np.pi))
        pull: Dual = -(stiffness * (x - rest)) - damping * rate
        return pull

    def _transmitted(self, x: Measurement) -> Dual:
        """Return a component of the force or torque that an entry transmits, at its first point on a body."""
        (name,) = x.arguments
        section = next(s for s, group in self.system.scene.model.entries.items() if name in group and s != "states")
        components = self._wrench(section, name)
        d = self.system.scene.dimension
        return components[AXES[x.axis] if x.kind == "force" else d + (0 if d == 2 else AXES[x.axis])]

    def _wrench(self, section: str, name: str) -> list[Dual]:
        """Return the force and the torque, in ground axes; their generalized forces are those of the rows."""
        at, system, d = self.at, self.system, self.system.scene.dimension
        own = [i for i, row in enumerate(system.rows) if (row.section, row.name) == (section, name)]
        path = f"{section}.{name}"

        def load(s: System) -> Any:
            part = dict(s.parts())[path].dynamics(at.q, at.u, at.time)
            return -(part.J.T @ at.nu) if own else -part.F0

        def marker(s: System) -> Marker:
            points = [m for m in _item(s.scene, section, name).points_acted_on() if m.body != GROUND]
            if points:
                return points[0]
            used = np.flatnonzero(load(system))
            body = next(
                b for b, part in enumerate(system.body_slices) if any(part.start <= i < part.stop for i in used)
            )
            return Marker(body, (0.0,) * d)

        body = marker(system).body
        columns = list(range(*system.body_slices[body].indices(system.n_q)))
        turns = (1 if d == 2 else 3) if system.scene.bodies[body].orientation else 0

        def unit(s: System, sizes: Sequence[Any]) -> System:
            point = marker(s)
            laws = tuple(map(Held, sizes))
            uses = [ElementUse("ground_force", (body,), point.point, laws[:d])]
            if turns:
                uses.append(ElementUse("ground_torque", (body,), (), laws[d:]))
            return acting_system(s.scene, [(self._entry(path), uses)])

        def force(s: System, sizes: Sequence[Any]) -> Any:
            probe = dict(unit(s, sizes).parts())[f"outputs.{path}"]
            return -probe.dynamics(at.q, at.u, at.time).F0

        W = np.stack([force(system, list(e))[columns] for e in np.eye(d + turns)], axis=1)
        values = np.linalg.solve(W, load(system)[columns])
        part = dict(system.parts())[path]
        K, R, _ = part.linearize(at.q, at.u, at.a, at.nu, at.time)
        turned = dict(unit(system, list(values)).parts())[f"outputs.{path}"]
        K = K - turned.linearize(at.q, at.u, at.a, np.zeros(0), at.time)[0]
        J = np.zeros((system.n_c, system.n_q))
        J[own] = system.dynamics(at.q, at.u, at.time).J[own]
        by_w = self._by_inputs(lambda s: load(s)[columns] - force(s, list(values))[columns])
        rows = [np.linalg.solve(W, x) for x in (-K[columns], -R[columns], -J.T[columns], by_w)]
        return [
            Dual(float(v), self._vector((0, rows[0][i]), (1, rows[1][i]), (3, rows[2][i]), (4, rows[3][i])))
            for i, v in enumerate(values)
        ]


def _distance(force: ItemValues) -> MeasureNumbers:
    """Return the distance of the two ends of a force with its numbers."""
    ends = force.markers("between")
    return MeasureNumbers("distance", tuple(x.body for x in ends), tuple(y for x in ends for y in x.point))


def _item(scene: Scene, section: str, name: str) -> ItemValues:
    """Return an entry of a scene."""
    return next(item for item in scene.items if (item.entry.section, item.name) == (section, name))
