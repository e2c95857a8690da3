"""What the measures in expressions and in outputs name in a model."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mbstab.errors import Location, alternatives, nearest
from mbstab.mechanics.catalogue import Kind
from mbstab.mechanics.measures import MEASURES, is_measure, parts
from mbstab.model.expressions import DERIVED, Expression, ExpressionError, Name, Rate
from mbstab.model.schema import (
    Components,
    Entry,
    MarkerValue,
    MeasureValue,
    Model,
    body_coordinates,
    constant,
    owner_of_point,
)
from mbstab.model.turns import count, counted_by
from mbstab.model.units import UNKNOWN, Known, Moving, dimension_of, moving, parse_unit, per_second, show
from mbstab.records import dataclass

TRANSMITTED = ("force", "torque", "effort")

_INSTEAD = {
    "effort": "share the expression of a force by definitions; of a controller with lag it is the state NAME_effort",
    "acceleration": "filter the rate, states: {w: {rate: (rate(x) - w)/T}}, and take rate(w)",
}
"""What expressions of the motion may contain instead of what stands in outputs only."""


def effort_unit(unit: str) -> str:
    """Return the unit of a force along a motion that has a unit: N*m along an angle or a turn rate."""
    return {"rad": "N*m", "rad/s": "N*m", "m": "N", "m/s": "N"}.get(unit, "")


def unit_of_expression(model: Model, expression: Expression) -> str:
    """Return the SI unit of an expression of the motion; an empty text if what the file declares does not decide it."""
    known: dict[str, Known] = {}
    for name, parameter in model.parameters.items():
        found = parse_unit(parameter.unit)[1] if parameter.unit else dimension_of(parameter.expression, known)
        # A bare number may be meant in any unit.
        known[name] = UNKNOWN if isinstance(found, str) else found
    counted = {name: counted_by(parameter.unit) for name, parameter in model.parameters.items()}
    for name in {*expression.names(), *expression.rates()} - known.keys() - {"t"}:
        # A speed such as vx(point) counts as the rate of itself.
        if unit := Measurement.of(name).unit_in(model).removesuffix("/s"):
            known[name], counted[name] = moving(unit), counted_by(unit)
    try:
        whole = dimension_of(expression, known)
    except ExpressionError:
        return ""
    if isinstance(whole, str):
        return ""
    unit = show(whole.dimension if isinstance(whole, Moving) else whole)
    angle = unit.partition("/")[0] == "1" and count(expression, counted).radians == 1
    return unit.replace("1", "rad", 1) if angle else unit


def unit_of_effort(model: Model, entry: Entry) -> str:
    """Return the unit of what an entry does along one motion: of a torque along angles, else of a force."""
    values, along = entry.values, "m"
    if entry.load is not None:
        along = Measurement.of(entry.load[0]).unit_in(model)
    elif "joint" in values:
        motions = model.entries["joints"][str(values["joint"])].kind.motions
        along = MEASURES[str(values.get("motion") or motions[0])].unit
    elif "coordinate" in values:
        along = model.unit_of(str(values["coordinate"]))
    return effort_unit(along)


def unit_of_output(model: Model, expression: Expression) -> str:
    """Return the SI unit of an output; an empty text if what the file declares does not decide it."""
    match expression.root:
        case Rate(name):
            return Measurement.of(name, rate=True).unit_in(model)
        case Name(name) if "." in name or "(" in name or name in model.states:
            return Measurement.of(name).unit_in(model)
        case _:
            return unit_of_expression(model, expression)


@dataclass(frozen=True)
class Measurement:
    """One thing that an output measures.

    Attributes
    ----------
    order : int
        0, 1 or 2: itself, its rate or its acceleration.
    kind : str
        A key of `MEASURES`, or ``coordinate``.
    arguments : tuple of str
        What it names; of a coordinate its name.
    axis : str
        Of what has components: ``x``, ``y`` or ``z``, or whatever stands in its place.
    """

    order: int
    kind: str
    arguments: tuple[str, ...]
    axis: str = ""

    @staticmethod
    def of(name: str, rate: bool = False) -> Measurement:
        """Return what a name in an output stands for, or with `rate` its rate: ``vx(a.p)`` is one."""
        order = int(rate)
        if name.startswith(f"{DERIVED[1]}("):
            order, name = 2, name[len(DERIVED[1]) + 1 : -1]
        if not is_measure(name):
            return Measurement(order, "coordinate", (name,))
        kind, arguments = parts(name)
        if not MEASURES[kind].arguments[0].endswith(".axis"):
            return Measurement(0 if MEASURES[kind].speed and order == 1 else order, kind, tuple(arguments))
        owner, _, axis = arguments[0].rpartition(".")
        return Measurement(order, kind, (owner or axis,), axis if owner else "")

    def unit_in(self, model: Model) -> str:
        """Return its SI unit."""
        if self.kind == "effort":
            entries = (
                x for section in model.entries.values() for name, x in section.items() if name == self.arguments[0]
            )
            return next(unit_of_effort(model, entry) for entry in entries if entry.has_effort)
        if self.kind == "coordinate":
            return model.unit_of(self.arguments[0], self.order)
        return per_second(MEASURES[self.kind].unit, self.order)


@dataclass(frozen=True)
class Places:
    """What measures may name.

    Attributes
    ----------
    dimension : int
    joints : mapping of Kind
    bodies : mapping of Entry
    points : mapping
        Points by name, for each body by name; None: the ground.
    unread : collection of str
        Bodies that have a problem of their own.
    """

    dimension: int
    joints: Mapping[str, Kind]
    bodies: Mapping[str, Entry]
    points: Mapping[str | None, Mapping[str, Components]]
    unread: Collection[str] = ()

    @staticmethod
    def of(model: Model) -> Places:
        """Return what the measures of a model may name."""
        points: dict[str | None, Mapping[str, Components]] = {None: model.ground}
        points.update((name, body.values.get("points", {})) for name, body in model.bodies.items())
        joints = {name: joint.kind for name, joint in model.entries["joints"].items()}
        return Places(model.dimension, joints, model.bodies, points)

    def meant(self, word: str, coordinates: Collection[str]) -> str:
        """Return what an unknown name with a dot may stand for, as a hint: ``z(a.tip)`` for ``a.tip.z``."""
        body, _, rest = word.partition(".")
        point, _, last = rest.rpartition(".")
        measure, known = MEASURES.get(last), self.points.get(None if body == "ground" else body, ())
        if measure is not None and self.dimension in measure.dimensions and body in (*self.bodies, "ground"):
            if measure.arguments == ("body",) or (measure.arguments == ("point",) and not point):
                return f"did you mean {f'{last}({body})'!r}?"
            if measure.arguments == ("point",) and (near := nearest(point, known)):
                return f"did you mean {f'{last}({body}.{near})'!r}?"
        own = [x.partition(".")[2] for x in coordinates if x.startswith(f"{body}.")]
        if near := nearest(rest, own):
            return f"did you mean {f'{body}.{near}'!r}?"
        return f"{body} has the coordinates {', '.join(own)}" if own else alternatives(word, coordinates, "coordinates")

    def measure(self, kind: str, arguments: Collection[str], at: int = 0) -> MeasureValue:
        """Return what a measure names.

        Raises
        ------
        ExpressionError
            If there is no such joint, point or body.
        """
        if kind not in MEASURES or MEASURES[kind].formula is None:
            raise ExpressionError(f"{kind}() stands in outputs only", at, _INSTEAD.get(kind, ""))
        if self.dimension not in MEASURES[kind].dimensions:
            hint = "turn rates in the plane are rate(body.theta)" if kind.startswith("w") else ""
            raise ExpressionError(f"{kind}() does not exist in a planar scene", at, hint)
        joint, points = None, []
        for role, word in zip(MEASURES[kind].arguments, arguments, strict=True):
            if role == "joint":
                joint = word
                self._check_joint(kind, word, at)
            else:
                points.append(self._point(word, at, role == "body"))
        return MeasureValue(kind, joint, tuple(points))

    def _check_joint(self, kind: str, word: str, at: int) -> None:
        """Refuse a joint that does not exist, or does not have this motion."""
        if word not in self.joints:
            raise ExpressionError(f"there is no joint {word!r}", at, alternatives(word, self.joints, "joints"))
        if kind not in self.joints[word].motions:
            has = " and ".join(self.joints[word].motions)
            raise ExpressionError(f"a {self.joints[word].name} joint has no {kind}{f', only {has}' if has else ''}", at)

    def _point(self, word: str, at: int, whole: bool) -> MarkerValue:
        """Return a point of a body or of the ground, or with `whole` a body with an orientation."""
        body, _, point = word.partition(".")
        owner = None if body == "ground" else body
        if owner is not None and owner not in self.bodies and owner not in self.unread:
            raise ExpressionError(
                f"there is no body {body!r}", at, alternatives(body, [*self.bodies, "ground"], "bodies")
            )
        known = self.bodies.get(owner or "")
        if whole and (point or owner is None or (known and len(body_coordinates(known)) == self.dimension)):
            raise ExpressionError(f"{word!r} is no body with an orientation", at)
        if not point or (owner is not None and known is None):  # a body with a problem of its own
            place = Location("", 1, 1)
            return MarkerValue(owner, Components((constant("0", place, ""),) * self.dimension, place, ""))
        points = self.points[owner]
        if point not in points:
            hint = alternatives(point, points, "its points")
            raise ExpressionError(f"{owner_of_point(owner)} has no point {point!r}", at, hint)
        return MarkerValue(owner, points[point])
