"""The section ``outputs``: expressions of what can be measured of a motion."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from mbstab.errors import suggestion
from mbstab.model.arithmetic import CONSTANTS
from mbstab.model.expressions import DERIVED, Expression, ExpressionError, filled_in, parse
from mbstab.model.measures import MEASURES, TRANSMITTED, Measure
from mbstab.model.quantities import AXES, QuantityReader
from mbstab.model.schema import Entry, Model, Quantity, TableValue
from mbstab.model.yamlfile import Scalar, YamlNode

Entries = Mapping[str, Mapping[str, Entry]]


def read_outputs(quantities: QuantityReader, node: YamlNode | None, entries: Entries) -> dict[str, Quantity]:
    """Return the outputs by name."""
    nodes, names, found = quantities.nodes, quantities.names, {}
    section = nodes.optional(node, "outputs")
    for key, item in section.pairs() if section else ():
        path = f"outputs.{key.text}"
        nodes.check_name(key, path, "output")
        if not isinstance(item, Scalar) or item.empty:
            nodes.complain(item, path, "expected an expression such as rod.theta or angle(pivot)")
            continue
        try:
            expression = _parsed(item.text, names.definitions, names.tables, entries)
            coordinates = [x for x in names.coordinates if not names.unread(x)]
            _check(expression.names(), entries, names.bodies, coordinates, names.parameters, names.dimension)
        except ExpressionError as error:
            quantities.complain(item, path, error)
            continue
        found[key.text] = Quantity(expression.text, expression.root, item.location, path)
    return found


def measured_expression(model: Model, text: str) -> Quantity:
    """Return an expression of what can be measured that does not stand in the file.

    Raises
    ------
    ExpressionError
        If it is none, or names what the file does not have.
    """
    expression = _parsed(text, model.definitions, model.tables, model.entries)
    _check(expression.names(), model.entries, model.bodies, model.coordinates(), model.parameters, model.dimension)
    return Quantity(expression.text, expression.root, model.reference.location, text)


def _parsed(
    text: str, definitions: Mapping[str, Expression], tables: Mapping[str, TableValue], entries: Entries
) -> Expression:
    measures = tuple(MEASURES)
    expression = parse(text, measures)
    written = _written_efforts(entries["forces"])
    return filled_in(expression, {**definitions, **written}, tables, measures)


def _written_efforts(forces: Mapping[str, Entry]) -> dict[str, Expression]:
    """Return efforts of controllers, motors and expressions along one motion, by what outputs call them."""
    found = {}
    for name, entry in forces.items():
        loads = entry.values.get("on")
        if entry.kind.effort is None and isinstance(loads, dict) and len(loads) == 1:
            (load,) = loads.values()
            found[f"effort({name})"] = Expression(load.text, load.root)
    return found


def _check(
    used: Mapping[str, int],
    entries: Entries,
    bodies: Mapping[str, Entry],
    coordinates: list[str],
    parameters: Mapping[str, object],
    dimension: int,
) -> None:
    """Refuse names that stand for nothing."""
    for name, at in used.items():
        if name in parameters:
            continue
        if name == "t":
            raise ExpressionError("the time t cannot be used here", at, "an output is measured at the reference motion")
        x = Measure.of(name)
        if x.kind == "coordinate":
            if x.owner not in coordinates:
                known = [*coordinates, *parameters, *MEASURES, *DERIVED, *CONSTANTS]
                raise ExpressionError(f"unknown coordinate {x.owner!r}", at, suggestion(x.owner, known))
            continue
        if x.order and x.kind in TRANSMITTED:
            raise ExpressionError(
                f"{DERIVED[x.order - 1]}(...) does not take {x.kind}(...)", at, "give the force itself"
            )
        if x.kind in ("angle", "displacement"):
            _check_joint(x, entries["joints"], at)
        elif x.kind == "place":
            _check_known(x.owner, bodies, "body", at)
            if x.point:
                _check_known(x.point, bodies[x.owner].values.get("points", {}), f"point of {x.owner!r}", at)
        elif x.kind == "effort":
            acting = [k for s in ("forces", "drives") for k, e in entries[s].items() if e.kind.effort is not None]
            acting += [text[len("effort(") : -1] for text in _written_efforts(entries["forces"])]
            _check_known(x.owner, acting, "force or drive along one motion", at)
        else:
            transmitting = {
                k: e
                for section, group in entries.items()
                if section != "states"
                for k, e in group.items()
                if section != "forces" or e.kind.transmits
            }
            _check_known(x.owner, transmitting, "joint, contact, drive or mount", at)
        _check_component(x, at, dimension)


def _check_joint(x: Measure, joints: Mapping[str, Entry], at: int) -> None:
    _check_known(x.owner, joints, "joint", at)
    motions = joints[x.owner].kind.motions
    if x.kind not in motions:
        hint = f"write {motions[0]}({x.owner})" if motions else "measure coordinates or the place of a point"
        raise ExpressionError(f"a {joints[x.owner].kind.name} joint has no single {x.kind}", at, hint)


def _check_known(word: str, known: Collection[str], what: str, at: int) -> None:
    if word not in known:
        raise ExpressionError(f"there is no {what} {word!r}", at, suggestion(word, known))


def _check_component(x: Measure, at: int, dimension: int) -> None:
    """Refuse a component that a vector does not have."""
    if x.kind not in ("place", "force", "torque"):
        return
    axes = ["z"] if x.kind == "torque" and dimension == 2 else list(AXES)[:dimension]
    if x.component not in axes:
        example = ".".join(part for part in (x.owner, x.point) if part)
        hint = " or ".join(f"{x.kind}({example}.{axis})" for axis in axes)
        raise ExpressionError(f"{x.kind}(...) needs a component of the vector", at, f"write {hint}")
