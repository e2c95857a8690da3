"""The section ``outputs``: expressions of what can be measured of a motion."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from mbstab.errors import alternatives, suggestion
from mbstab.mechanics.measures import MEASURES
from mbstab.model.expressions import DERIVED, Expression, ExpressionError, filled_in, parse
from mbstab.model.measures import TRANSMITTED, Measurement, Places
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
            _check(expression, entries, names.places, coordinates, names.parameters)
            quantities.doubt_sums(expression, item, path)
        except ExpressionError as error:
            if any(nodes.faulty(f"{section}.{x}") for section in names.written for x in _named(item.text)):
                continue  # what it names has a problem of its own
            quantities.complain(item, path, error)
            continue
        found[key.text] = Quantity(expression.text, expression.root, item.location, path)
    return found


def _named(text: str) -> set[str]:
    """Return the words of an expression, and those before an underscore: ``pid_effort`` is a state of ``pid``."""
    words = set(re.findall(r"[A-Za-z]\w*", text))
    return words | {word[:i] for word in words for i, letter in enumerate(word) if letter == "_"}


def measured_expression(model: Model, text: str) -> Quantity:
    """Return an expression of what can be measured that does not stand in the file.

    Raises
    ------
    ExpressionError
        If it is none, or names what the file does not have.
    """
    expression = _parsed(text, model.definitions, model.tables, model.entries)
    _check(expression, model.entries, Places.of(model), model.coordinates(), model.parameters)
    return Quantity(expression.text, expression.root, model.reference.location, text)


def _parsed(
    text: str, definitions: Mapping[str, Expression], tables: Mapping[str, TableValue], entries: Entries
) -> Expression:
    return filled_in(parse(text), {**definitions, **_written_efforts(entries["forces"])}, tables)


def _written_efforts(forces: Mapping[str, Entry]) -> dict[str, Expression]:
    """Return efforts of controllers, motors and expressions along one motion, by what outputs call them."""
    given = {name: entry.load for name, entry in forces.items()}
    return {f"effort({name})": Expression(x[1].text, x[1].root) for name, x in given.items() if x is not None}


def _check(
    expression: Expression,
    entries: Entries,
    places: Places,
    coordinates: Collection[str],
    parameters: Collection[str],
) -> None:
    """Refuse names that stand for nothing."""
    for used, rate in ((expression.names(), False), (expression.rates(), True)):
        for name, at in used.items():
            if name == "t":
                hint = "an output is measured at the reference motion"
                raise ExpressionError("the time t cannot be used here", at, hint)
            x = Measurement.of(name, rate)
            if x.kind != "coordinate":
                _check_measure(x, entries, places, at)
            elif name not in parameters and x.arguments[0] not in coordinates:
                word = x.arguments[0]
                hint = suggestion(word, parameters) or places.meant(word, coordinates)
                raise ExpressionError(f"unknown coordinate {word!r}", at, hint)


def _check_measure(x: Measurement, entries: Entries, places: Places, at: int) -> None:
    """Refuse a measure that a scene does not have."""
    fixed = x.kind in TRANSMITTED
    if x.order and (fixed or MEASURES[x.kind].speed):
        hint = "give the force itself" if fixed else "give the speed itself"
        raise ExpressionError(f"{DERIVED[x.order - 1]}(...) does not take {x.kind}(...)", at, hint)
    if x.kind == "effort":
        acting = [e for group in entries.values() for e in group.values() if e.has_effort]
        _check_known(x.arguments[0], acting, "force or drive along one motion", at)
    elif fixed:
        transmitting = [e for group in entries.values() for e in group.values() if e.has_reaction]
        _check_known(x.arguments[0], transmitting, "joint, contact, drive or mount", at)
    elif x.kind != "place":
        places.measure(x.kind, x.arguments, at)
    if x.kind == "place" or (fixed and x.kind != "effort"):
        _check_axis(x, at, places.dimension)
    if x.kind == "place":
        places.measure(x.axis, x.arguments, at)


def _check_known(word: str, known: Collection[Entry], what: str, at: int) -> None:
    sections = [entry.section for entry in known if entry.name == word]
    if not sections:
        raise ExpressionError(
            f"there is no {what} {word!r}", at, alternatives(word, [x.name for x in known], "there are")
        )
    if len(sections) > 1:
        message = f"there are several called {word!r}, in {' and '.join(sections)}"
        raise ExpressionError(message, at, "give one of them another name")


def _check_axis(x: Measurement, at: int, dimension: int) -> None:
    """Refuse a component that a vector does not have."""
    axes = ["z"] if x.kind == "torque" and dimension == 2 else list(AXES)[:dimension]
    if x.axis not in axes:
        hint = " or ".join(f"{x.kind}({x.arguments[0]}.{axis})" for axis in axes)
        raise ExpressionError(f"{x.kind}(...) needs a component of the vector", at, f"write {hint}")
