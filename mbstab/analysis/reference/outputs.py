"""The outputs of a file along a motion: what its expressions of coordinates, measures and forces are at its states."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbstab.analysis.reference.efforts import Acted
from mbstab.compiler.measured import frames, occurring
from mbstab.compiler.system import Array, System
from mbstab.model.arithmetic import array_arithmetic
from mbstab.model.evaluator import Evaluator
from mbstab.model.jets import Jet
from mbstab.model.measures import TRANSMITTED, Measurement, Places, unit_of_output
from mbstab.model.values import measure_numbers

Loads = Mapping[tuple[str, str, str], Array]
"""Components of reactions, as of `mbstab.analysis.reference.reactions.components`."""


class Outputs:
    """The outputs of a scene.

    Parameters
    ----------
    system : System
        In the angles of the file.

    Attributes
    ----------
    names : tuple of (str, str)
        The outputs, each with its unit, if it has a known one.
    """

    def __init__(self, system: System) -> None:
        self.scene, self._coordinates = system.scene, system.names
        model = self.scene.model
        self._expressions = {name: self.scene.rationals.settled(x) for name, x in model.outputs.items()}
        self.names = tuple((name, unit_of_output(model, x)) for name, x in model.outputs.items())
        self._wanted: dict[str, Measurement] = {}
        for x in self._expressions.values():
            self._wanted |= {name: Measurement.of(name) for name in x.names() if name not in self.scene.parameters}
            self._wanted |= {f"rate({name})": Measurement.of(name, rate=True) for name in x.rates()}

    def measured(self, system: System, q: Array, u: Array, a: Array) -> dict[str, Array]:
        """Return the measures of bodies in the outputs at states, each of shape (…).

        Parameters
        ----------
        system : System
            The scene in any angles.
        q, u, a : ndarray, shape (…, n_q)
            In these angles; leading axes run over states.
        """
        scene, found = system.scene, {}
        evaluator, places = Evaluator(scene.model, scene.parameters, scene.arithmetic), Places.of(scene.model)
        moving = {name: Jet(q[..., i], u[..., i], a[..., i]) for i, name in enumerate(system.names)}
        joints = {item.name: item for item in scene.items if item.entry.section == "joints"}
        for name, x in self._wanted.items():
            if x.kind == "coordinate" or x.kind in TRANSMITTED:
                continue
            what = places.measure(x.axis or x.kind, x.arguments)
            called = f"{what.kind}({', '.join(x.arguments)})"
            # Angles count as in the forces that contain them, from where the motion was found.
            numbers = scene.measures.get(called) or measure_numbers(what, evaluator, joints.__getitem__)
            one, values = occurring(scene, called, numbers)
            jet = Jet.of(one.of(frames(array_arithmetic(), scene, moving), iter(values)))
            found[name] = np.asarray(np.broadcast_to((jet.value, jet.rate, jet.second)[x.order], q.shape[:-1]))
        return found

    def values(
        self, measured: Mapping[str, Array], q: Array, u: Array, a: Array, loads: Loads, efforts: list[Acted]
    ) -> Array:
        """Return the outputs at states, shape (…, outputs); not finite where one has no value.

        Parameters
        ----------
        measured : mapping
            As from `measured`.
        q, u, a : ndarray, shape (…, n_q)
            In the angles of the file.
        loads, efforts
            What is transmitted, and acts along one motion, at these states.
        """
        shape = q.shape[:-1]
        known = {**self.scene.parameters, **measured}
        for name, x in self._wanted.items():
            if x.kind == "coordinate":
                known[name] = (q, u, a)[x.order][..., self._coordinates.index(x.arguments[0])]
            elif x.kind in TRANSMITTED:
                known[name] = self._transmitted(x, loads, efforts)
        found = []
        with np.errstate(all="ignore"):
            for expression in self._expressions.values():
                rates = {name: known[f"rate({name})"] for name in expression.rates()}
                found.append(np.broadcast_to(expression.evaluate(known, array_arithmetic(), rates), shape))
        return np.stack(found, axis=-1).astype(float) if found else np.zeros((*shape, 0))

    def _transmitted(self, x: Measurement, loads: Loads, efforts: list[Acted]) -> Array | float:
        owners = {
            item.entry.called
            for item in self.scene.items
            if item.name == x.arguments[0] and item.entry.section != "states"
        }
        if x.kind == "effort":
            return next(acted.values for acted in efforts if acted.owner in owners)
        component = f"{x.kind} {x.axis}"
        return next((v for (owner, _, what), v in loads.items() if owner in owners and what == component), 0.0)
