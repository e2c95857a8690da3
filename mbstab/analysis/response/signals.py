"""What the inputs of a model do to the linearized equations.

An input w, zero at the reference, adds f w to the equations of motion, c w to the holonomic rows and d w to the
nonholonomic ones:

    M Δa + R Δu + K Δq + Jᵀ Δν + f w = 0,   C_q Δq + c w = 0,   D_u Δu + D_q Δq + d w = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mbstab.compiler.system import Array, System
from mbstab.mechanics.catalogue import ElementUse, Kind
from mbstab.model.arithmetic import FLOAT
from mbstab.model.duals import Dual, dual_arithmetic
from mbstab.model.evaluator import Evaluator
from mbstab.model.expressions import Binary, Name
from mbstab.model.jets import Jet
from mbstab.model.scene import ItemValues, Scene
from mbstab.model.schema import Entry, Model, Parameter, Quantity, Reference, constant
from mbstab.model.units import si_unit
from mbstab.model.values import evaluate
from mbstab.records import dataclass

SIGNAL = "signal of the input"
"""A parameter of this name, which no file can have, is added to the function of a drive."""


@dataclass(frozen=True)
class State:
    """Where the equations are differentiated: q, u, a of shape (n_q,), nu of shape (n_c,), time (s)."""

    q: Array
    u: Array
    a: Array
    nu: Array
    time: float


@dataclass(frozen=True)
class Held:
    """A function of time with given value, rate and second derivative."""

    value: Any
    rate: Any = 0.0
    second: Any = 0.0

    def at(self, time: Any) -> Jet:
        """Return them."""
        return Jet(self.value, self.rate, self.second)


@dataclass(frozen=True)
class _Probe:
    """Elements in the place of an entry of a scene."""

    entry: Entry
    kind: Kind


def acting_system(scene: Scene, groups: Sequence[tuple[Entry, Sequence[ElementUse]]]) -> System:
    """Return the equations of a scene in which other elements act instead of its entries."""
    probes: list[Any] = [
        _Probe(entry, Kind(entry.kind.name, "", (2, 3), (), lambda item, uses=uses: uses))  # type: ignore[misc]
        for entry, uses in groups
    ]
    return System(replace(scene, items=probes))


def slopes(x: Any) -> Array:
    """Return the slopes of an array of dual numbers."""
    flat = [float(y.slope) if isinstance(y, Dual) else 0.0 for y in np.ravel(x)]
    return np.array(flat).reshape(np.shape(x))


class Signals:
    """The inputs of a scene.

    Parameters
    ----------
    system : System

    Attributes
    ----------
    items : tuple of ItemValues
    units : list of str
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self.items = system.scene.inputs
        self.units = [_unit(item) for item in self.items]
        self._forces: dict[str, System] = {}
        groups = []
        for item in self.items:
            uses = [replace(use, laws=tuple(map(Held, use.laws))) for use in item.kind.build(item)]
            if uses:
                groups.append((item.entry, uses))
        if groups:
            self._forces = dict(acting_system(system.scene, groups).parts())
        self.changed: dict[int, System] = {
            i: _changed(system.scene.model, item)
            for i, item in enumerate(self.items)
            if item.entry.path not in self._forces
        }
        """Systems whose numbers carry slopes by an input, by the number of the input."""

    def columns(self, at: State) -> tuple[Array, Array]:
        """Return f, shape (n_q, inputs), and c above d, shape (n_c, inputs)."""
        n, c, m = self.system.n_q, self.system.n_c, len(self.items)
        f, rows = np.zeros((n, m)), np.zeros((c, m))
        for i, item in enumerate(self.items):
            if i in self.changed:
                state = self.changed[i].dynamics(at.q, at.u, at.time)
                f[:, i] = slopes(state.M) @ at.a + slopes(state.F0) + slopes(state.J).T @ at.nu
                rows[:, i] = slopes(state.E)
            else:
                f[:, i] = self._forces[item.entry.path].dynamics(at.q, at.u, at.time).F0
        return f, rows


def _unit(item: ItemValues) -> str:
    """Return the SI unit of an input."""
    values, kind, model = item.entry.values, item.entry.kind.name, item.evaluator.model
    if kind == "force":
        return "N"
    if kind == "torque":
        return "N*m"
    if kind == "parameter":
        return si_unit(model.parameters[str(values["parameter"])].unit)
    if kind == "joint":
        motion = values.get("motion") or model.entries["joints"][str(values["joint"])].kind.motions[0]
        return "N*m" if motion == "angle" else "N"
    return ""


def _changed(model: Model, item: ItemValues) -> System:
    """Return the system whose numbers carry slopes by a parameter, or by what is added to the function of a drive."""
    values = item.entry.values
    name = str(values.get("parameter", SIGNAL))
    if "drive" in values:
        drive = model.entries["drives"][str(values["drive"])]
        key = "position" if "position" in drive.values else "velocity"
        law = drive.values[key]
        added = Binary("+", law.root, Name(SIGNAL, 0), 0)
        driven = replace(drive, values={**drive.values, key: Quantity(law.text, added, law.location, law.path)})
        drives = {**model.entries["drives"], drive.name: driven}
        none = Parameter(SIGNAL, constant("0", drive.location, drive.path), drive.location)
        model = replace(
            model, entries={**model.entries, "drives": drives}, parameters={**model.parameters, SIGNAL: none}
        )
    nominal = 0.0 if name == SIGNAL else float(item.evaluator.parameters[name])
    model = replace(model, reference=_held(model.reference, item.evaluator))
    return System(evaluate(model, {name: Dual(nominal, 1.0)}, dual_arithmetic(FLOAT)))


def _held(reference: Reference, evaluator: Evaluator) -> Reference:
    """Return the reference with numbers: no input moves it, nor what counts from it, such as the offset of a gear."""

    def numbers(values: dict[str, Quantity]) -> dict[str, Quantity]:
        return {
            name: constant(repr(float(evaluator.number(value))), value.location, value.path)
            for name, value in values.items()
        }

    return replace(
        reference,
        coordinates=numbers(reference.coordinates),
        rates=numbers(reference.rates),
        guess=numbers(reference.guess),
        guess_rates=numbers(reference.guess_rates),
    )
