"""A model with numbers: parameters evaluated, entries resolved, every number checked.

Values may be floats or arrays over the points of a sweep; the checks then hold for all points.
"""

from __future__ import annotations

import contextlib
import copyreg
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from mbstab.mechanics import vectors
from mbstab.mechanics.bodies import combine
from mbstab.mechanics.catalogue import GROUND, Number, Vector
from mbstab.mechanics.frames import Frame
from mbstab.mechanics.joints import motion_parameters
from mbstab.mechanics.measures import MEASURES
from mbstab.model.arithmetic import FLOAT, Arithmetic, array_arithmetic
from mbstab.model.charts import euler_matrix, regular
from mbstab.model.evaluator import Evaluator
from mbstab.model.numbers import all_of, is_finite, nominal
from mbstab.model.parameters import evaluate_parameters
from mbstab.model.scene import BodyValues, InitialValues, ItemValues, MeasureNumbers, Scene, SteadyValues
from mbstab.model.schema import (
    Entry,
    MeasureValue,
    Model,
    Quantity,
    Steady,
    body_coordinates,
)
from mbstab.model.turned import at_reference

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


def evaluate(
    model: Model,
    overrides: Mapping[str, Number] | None = None,
    arithmetic: Arithmetic | None = None,
    added: Mapping[str, Number] | None = None,
    checked: bool = False,
) -> Scene:
    """Return the scene at the given parameter values (SI), `added` as in `evaluate_parameters`.

    With `checked`, the same values have passed in another arithmetic: numbers that no element uses are left out.

    Raises
    ------
    ModelFileError
        With every number that is out of range, at its place in the file.
    UsageError
        If a parameter to be replaced is unknown.
    """
    overrides = overrides or {}
    if arithmetic is None:
        arithmetic = array_arithmetic() if any(hasattr(v, "shape") for v in overrides.values()) else FLOAT
    with _quiet(arithmetic):
        return _Assembly(model, evaluate_parameters(model, overrides, arithmetic, added), arithmetic, checked).scene()


def _evaluate_again(model: Model, parameters: dict[str, Number], fields: dict[str, Any]) -> Scene:
    return replace(evaluate(model, parameters), **fields)


def _as_numbers(scene: Scene) -> tuple[Callable[..., Scene], tuple[object, ...]]:
    """Return what a scene is made of again, in another process too: the model, and what has changed since."""
    kept = ("bodies", "time", "coordinates", "rates", "guess", "turned", "balances")
    return _evaluate_again, (scene.model, scene.parameters, {name: getattr(scene, name) for name in kept})


copyreg.pickle(Scene, _as_numbers)


def _quiet(arithmetic: Arithmetic) -> contextlib.AbstractContextManager[Any]:
    """Return a context without NumPy's warnings; the checks report values that are not finite."""
    if arithmetic.name != "array":
        return contextlib.nullcontext()
    import numpy as np

    return np.errstate(all="ignore")


def measure_numbers(value: MeasureValue, evaluator: Evaluator, joint: Callable[[str], ItemValues]) -> MeasureNumbers:
    """Return a measure with numbers; `joint` finds joints by name."""
    if value.joint is not None:
        return joint_measure(value.kind, joint(value.joint))
    bodies = tuple(GROUND if x.body is None else evaluator.body_numbers[x.body] for x in value.points)
    points = () if MEASURES[value.kind].arguments == ("body",) else value.points
    return MeasureNumbers(value.kind, bodies, tuple(y for x in points for y in evaluator.vector(x.point, length=True)))


def joint_measure(kind: str, joint: ItemValues) -> MeasureNumbers:
    """Return the angle or the displacement of a joint with its numbers."""
    bodies, numbers = tuple(marker.body for marker in joint.markers("between")), motion_parameters(joint, kind)
    in_space = kind == "angle" and joint.dimension == 3
    return MeasureNumbers(kind, bodies, at_reference(joint, numbers) if in_space else numbers)


def principal_moments(inertia: Vector) -> npt.NDArray[np.float64]:
    """Return the principal moments of a body in space, ascending, shape (…, 3)."""
    import numpy as np

    numbers = [np.asarray(x, dtype=float) for x in inertia]
    xx, yy, zz, xy, xz, yz = numbers if all(x.ndim == 0 for x in numbers) else np.broadcast_arrays(*numbers)
    if not (xy.any() or xz.any() or yz.any()):
        return np.sort(np.stack([xx, yy, zz], -1))
    tensor = np.stack([np.stack([xx, xy, xz], -1), np.stack([xy, yy, yz], -1), np.stack([xz, yz, zz], -1)], -2)
    return np.linalg.eigvalsh(tensor)


class _Assembly(Evaluator):
    """Puts a scene together."""

    def scene(self) -> Scene:
        model, reference = self.model, self.model.reference
        gravity = self.vector(model.gravity)
        time = self.number(reference.time)
        bodies = tuple(self.body(entry, time) for entry in model.bodies.values())
        coordinates, rates, guess, guess_rates = (
            {name: self.number(value) for name, value in values.items()}
            for values in (reference.coordinates, reference.rates, reference.guess, reference.guess_rates)
        )
        self.poses = self.start(bodies, guess | coordinates)
        named: dict[str, ItemValues] = {}
        for section in ("joints", "contacts"):
            named.update((entry.path, ItemValues(entry, self, named)) for entry in model.entries[section].values())
        items = [
            named.get(entry.path) or ItemValues(entry, self, named)
            for section in model.order
            for entry in model.entries[section].values()
        ]
        inputs = tuple(ItemValues(entry, self, named) for entry in model.inputs.values())
        for item in () if self.checked else (*items, *inputs):
            item.check(time)
        if reference.find is None:
            unsaid = (name for name in model.states if name not in coordinates and name not in guess)
            coordinates.update((name, self.f.number("0")) for name in unsaid)
        steady, period = self.steady(reference.steady), self.period(reference.period)
        initial = self.initial()
        self.document.raise_problems()
        return regular(Scene(
            model, self.f, self.parameters, gravity, bodies, items, time, coordinates, rates, guess, steady,
            period, self.points(), self.lengths, initial, inputs=inputs, guess_rates=guess_rates,
            measures={name: measure_numbers(x, self, lambda joint: named[f"joints.{joint}"])
                      for name, x in model.measures.items()},
        ))  # fmt: skip

    def start(self, bodies: tuple[BodyValues, ...], said: Mapping[str, Number]) -> dict[int, Frame]:
        d, zero = self.model.dimension, self.f.number("0")
        names = {i: [f"{body.name}.{c}" for c in body.coordinates] for i, body in enumerate(bodies)}
        poses = {i: Frame(self.f, d, [said.get(x, zero) for x in own], bodies[i].base) for i, own in names.items()}
        return poses | {GROUND: Frame(self.f, d, ())}

    def initial(self) -> InitialValues:
        given = self.model.initial
        time = None if given.time is None else self.number(given.time)
        coordinates, rates = (
            {name: self.number(value) for name, value in values.items()} for values in (given.coordinates, given.rates)
        )
        return InitialValues(time, coordinates, rates)

    def points(self) -> int | None:
        return next((len(value) for value in self.parameters.values() if getattr(value, "ndim", 0)), None)

    def steady(self, steady: Steady | None) -> SteadyValues | None:
        if steady is None:
            return None
        axis, direction = (
            None if x is None else vectors.unit(self.direction(x), self.f.sqrt) for x in (steady.axis, steady.direction)
        )
        rate, speed = (None if x is None else self.number(x) for x in (steady.rate, steady.speed))
        point = (0.0,) * self.model.dimension if steady.point is None else self.vector(steady.point)
        return SteadyValues(axis, rate, point, direction, speed)

    def period(self, period: Quantity | None) -> Number | None:
        if period is None:
            return None
        value = self.number(period)
        if not self.symbolic and not all_of(value > 0):
            self.complain(period, f"the period must be positive, got {nominal(value):g} s")
        return value

    # --- bodies -----------------------------------------------------------------------------------------------------

    def body(self, entry: Entry, time: Number) -> BodyValues:
        """Return a body with its numbers, after a check of all of them."""
        dimension = self.model.dimension
        coordinates = body_coordinates(entry)
        base: Vector = tuple(float(i == j) for i in range(3) for j in range(3)) if dimension == 3 else ()
        item = ItemValues(entry, self, {})
        if not self.checked:
            item.check(time)
        if len(coordinates) == dimension:
            inertia, center = (0.0,) * (1 if dimension == 2 else 6), (0.0,) * dimension
            return BodyValues(
                entry.name, entry.location, False, item.number("mass"), inertia, center, base, coordinates
            )
        mass, center, inertia = self._distribution(item)
        if item.given("axes"):
            base = euler_matrix(item.value("axes"), self.f)
        return BodyValues(entry.name, entry.location, True, mass, inertia, center, base, coordinates)

    def _distribution(self, item: ItemValues) -> tuple[Number, Vector, Vector]:
        """Return mass (kg), centre of mass (m) and inertia about it (kg·m²) of a body."""
        dimension, entry = self.model.dimension, item.entry
        if item.given("parts"):
            mass, center, inertia = combine(item.value("parts"), dimension)
            self._check_inertia(entry, "parts", (mass, *center, *inertia), inertia)
            return mass, center, inertia
        mass = item.number("mass")
        center = item.vector("center_of_mass") if item.given("center_of_mass") else (0.0,) * dimension
        if item.given("shape"):
            moments = item.value("shape")(mass)
            inertia = moments[2:] if dimension == 2 else (*moments, 0.0, 0.0, 0.0)
            self._check_inertia(entry, "shape", inertia, inertia)
            return mass, center, inertia
        inertia = item.value("inertia")
        self._check_inertia(entry, "inertia", inertia, inertia)
        return mass, center, inertia

    def _check_inertia(self, entry: Entry, name: str, numbers: Vector, inertia: Vector) -> None:
        """Refuse principal moments that are negative, or one that exceeds the sum of the other two."""
        if not self.judges:
            return

        def complain(message: str, hint: str = "") -> None:
            self.document.complain(entry.places[name], f"{entry.path}.{name}", message, hint)

        if not all(is_finite(x) for x in numbers):
            complain("mass and inertia are not finite")
            return
        if len(inertia) == 1:
            if not all_of(inertia[0] >= 0):
                complain(f"inertia must not be negative, got {nominal(inertia[0]):g} kg*m^2")
            return
        import numpy as np

        moments = principal_moments(inertia)
        slack = 1e-12 * np.abs(moments).max(axis=-1)
        low, middle, high = (moments[..., i] for i in range(3))
        shown = ", ".join(f"{x:g}" for x in moments.reshape(-1, 3)[0])
        if not np.all(low >= -slack):
            complain(f"inertia must be positive: its principal moments are {shown} kg*m^2")
        elif not (entry.values.get("measured") or np.all(low + middle >= high - slack)):
            hint = (
                "no principal moment of a body exceeds the sum of the other two; measured: true takes them as they are"
            )
            complain(f"impossible inertia: its principal moments are {shown} kg*m^2", hint)
