"""Outputs of a model: what is measured at a state, with its slopes.

A slope is a vector over Δq, Δu, Δa, Δν and, for each input, over w, ẇ and ẅ, one after the other. Angles, travels
and places are rows of constraints whose error is measured; what joints transmit follows from their multipliers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbstab.analysis.response.signals import Held, Signals, State, acting_system, slopes
from mbstab.compiler.system import Array, System
from mbstab.mechanics.catalogue import GROUND, Effort, ElementUse, Kind, Marker
from mbstab.mechanics.joints import motion_parameters
from mbstab.model.arithmetic import FLOAT
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.model.evaluator import Evaluator
from mbstab.model.measures import Measure
from mbstab.model.quantities import AXES
from mbstab.model.scene import ItemValues, Scene
from mbstab.model.schema import Entry, Quantity

_KIND = Kind("probe", "", (2, 3), (), lambda item: ())
_ON_AXES = tuple(tuple(float(i == j) for j in range(3)) for i in range(3))
Three = tuple[Dual, Dual, Dual]


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
        self._measured: dict[tuple[str, ...], Three] = {}

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
        names = {
            name: self._constant(lambda s, name=name: s.parameters[name])  # type: ignore[misc]
            if name in scene.parameters
            else self._value(Measure.of(name))
            for name in expression.names()
        }
        found = expression.evaluate(names, dual_arithmetic(FLOAT))
        return np.asarray(found.slope) if isinstance(found, Dual) else np.zeros(self.size)

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

    def _value(self, x: Measure) -> Dual:
        if x.kind == "coordinate":
            i = self.system.names.index(x.owner)
            value = (self.at.q, self.at.u, self.at.a)[x.order][i]
            return Dual(float(value), self._vector((x.order, np.eye(self.system.n_q)[i])))
        if x.kind in ("angle", "displacement"):
            return self._motion(x.kind, x.owner)[x.order]
        if x.kind == "place":
            return self._place(x.owner, x.point, AXES[x.component])[x.order]
        if x.kind == "effort":
            return self._effort(x.owner)
        return self._transmitted(x)

    # --- motions ----------------------------------------------------------------------------------------------------

    def _motion(self, kind: str, joint: str) -> Three:
        def uses(scene: Scene, law: Held) -> list[ElementUse]:
            item = _item(scene, "joints", joint)
            first, second = item.markers("between")
            return [ElementUse(f"{kind}_position", (first.body, second.body), motion_parameters(item, kind), (law,))]

        return self._rows((kind, joint), uses, self.system.scene.dimension == 3 and kind == "angle")

    def _place(self, body: str, point: str, axis: int) -> Three:
        def marker(scene: Scene) -> Marker:
            entry, number = scene.model.bodies[body], list(scene.model.bodies).index(body)
            if not point:
                return Marker(number, (0.0,) * scene.dimension)
            evaluator = Evaluator(scene.model, scene.parameters, scene.arithmetic)
            return Marker(number, evaluator.vector(entry.values["points"][point]))

        return self._point((body, point), marker, axis)

    def _point(self, key: tuple[str, ...], marker: Callable[[Scene], Marker], axis: int) -> Three:
        def uses(scene: Scene, law: Held) -> list[ElementUse]:
            at = marker(scene)
            return [ElementUse("point_position", (at.body,), (*at.point, *_ON_AXES[axis][: scene.dimension]), (law,))]

        return self._rows(("place", *key, str(axis)), uses, False)

    def _rows(self, key: tuple[str, ...], uses: Callable[[Scene, Held], list[ElementUse]], turning: bool) -> Three:
        """Return a motion, its rate and its acceleration; that of a joint that turns is known by its sine."""
        if key in self._measured:
            return self._measured[key]
        at, entry = self.at, self._entry(" ".join(key))

        def of(system: System, law: Held) -> System:
            return acting_system(system.scene, [(entry, uses(system.scene, law))])

        def error(law: Held) -> float:
            return float(of(self.system, law).dynamics(at.q, at.u, at.time).E[0])

        value = error(Held(0.0))
        if turning:
            value = float(np.arctan2(value, error(Held(-0.5 * np.pi))))
        held = Held(value)
        rate = float(of(self.system, held).dynamics(at.q, at.u, at.time).V[0])
        held = Held(value, rate)
        row = of(self.system, held)
        state = row.dynamics(at.q, at.u, at.time)
        V_q, A_q, A_u = (x[0] for x in row.linearize_rows(at.q, at.u, at.a, at.time))
        J, zero = state.J[0], np.zeros(len(self.signals.items))

        def three(system: System) -> Any:
            found = of(system, held).dynamics(at.q, at.u, at.time)
            return np.array([found.E[0], found.V[0], found.J[0] @ at.a + found.B[0]], dtype=object)

        e, v, a = self._by_inputs(three) if self.signals.changed else np.zeros((3, len(zero)))
        found = (
            Dual(value, self._vector((0, J), (4, e))),
            Dual(rate, self._vector((0, V_q), (1, J), (4, v), (5, e))),
            Dual(float(J @ at.a + state.B[0]), self._vector((0, A_q), (1, A_u), (2, J), (4, a), (5, 2.0 * v), (6, e))),
        )
        self._measured[key] = found
        return found

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
            x, rate = self._distance(given.of.name)
        else:
            x, rate, _ = self._motion(given.motion, given.of.name)
        stiffness, rest, damping = (
            self._constant(lambda scene, key=key: getattr(effort(scene), key))  # type: ignore[misc]
            for key in ("stiffness", "rest", "damping")
        )
        if given.motion == "angle" and self.system.scene.dimension == 3:
            # The angle within half a turn of the rest.
            x = x - 2.0 * np.pi * round((x.value - rest.value) / (2.0 * np.pi))
        found: Dual = -(stiffness * (x - rest)) - damping * rate
        return found

    def _distance(self, name: str) -> tuple[Any, Any]:
        """Return the distance of the two ends of a force, and its rate."""

        def end(k: int) -> Callable[[Scene], Marker]:
            return lambda scene: _item(scene, "forces", name).markers("between")[k]

        d = self.system.scene.dimension
        gap: list[Any] = [0.0] * d
        speed: list[Any] = [0.0] * d
        for k, sign in ((0, 1.0), (1, -1.0)):
            for axis in range(d):
                if end(k)(self.system.scene).body == GROUND:
                    fixed = self._constant(lambda scene, k=k, axis=axis: end(k)(scene).point[axis])  # type: ignore[misc]
                    gap[axis] = gap[axis] + sign * fixed
                    continue
                place, rate, _ = self._point((name, str(k)), end(k), axis)
                gap[axis], speed[axis] = gap[axis] + sign * place, speed[axis] + sign * rate
        length = dual_arithmetic(FLOAT).sqrt(sum(x * x for x in gap))
        return length, sum(x * v for x, v in zip(gap, speed, strict=True)) / length

    def _transmitted(self, x: Measure) -> Dual:
        """Return a component of the force or torque that an entry transmits, at its first point on a body."""
        section = next(s for s, group in self.system.scene.model.entries.items() if x.owner in group and s != "states")
        components = self._wrench(section, x.owner)
        d = self.system.scene.dimension
        return components[AXES[x.component] if x.kind == "force" else d + (0 if d == 2 else AXES[x.component])]

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


def _item(scene: Scene, section: str, name: str) -> ItemValues:
    """Return an entry of a scene."""
    return next(item for item in scene.items if (item.entry.section, item.name) == (section, name))
