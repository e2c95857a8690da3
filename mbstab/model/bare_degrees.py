"""Angles written as bare numbers of more than a turn: most likely degrees, where radians count."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mbstab.model.expressions import Binary, Name, Negative, Node, Number
from mbstab.model.measures import Measurement
from mbstab.model.schema import Entry, Model, Quantity, is_angle


def bare_degrees(model: Model) -> list[str]:
    """Return warnings about bare numbers of more than a turn as angles of a state, or to which something holds angles.

    Turns that are meant are written with ``pi`` or ``deg``, or stand in a parameter.
    """
    entries = (*model.entries["forces"].values(), *model.entries["drives"].values())
    angles = [(f"{entry.called}, {key}", number) for entry in entries for key, number in _angles(model, entry)]
    for state in (model.reference.coordinates, model.reference.guess, model.initial.coordinates):
        given = ((name, value) for name, value in state.items() if "." in name and is_angle(name))
        angles += [(value.path, number) for name, value in given for _, number in _numbers(name, value)]
    return list(
        dict.fromkeys(
            f"{where}: {number.text} rad are {float(number.text) / (2.0 * math.pi):.3g} turns\n"
            f"hint: degrees are written {number.text}*deg; turns that are meant, with 2*pi"
            for where, number in angles
            if float(number.text) > 2.0 * math.pi
        )
    )


def _angles(model: Model, entry: Entry) -> Iterator[tuple[str, Number]]:
    """Yield the numbers that an entry adds to angles or compares with them, each with its key."""
    values = entry.values
    for key in ("position", "rest"):
        if key in values and _turns(model, entry):
            yield from _numbers(key, values[key])
    of = values.get("of")
    if "target" in values and of is not None and _angular(model, of.root):
        yield from _numbers("target", values["target"])
    for key in ("of", "signal", "gains"):
        given = values.get(key, ())
        for signal in (given,) if isinstance(given, Quantity) else given:
            if _angular(model, signal.root):
                yield from _numbers(key, signal)


def _turns(model: Model, entry: Entry) -> bool:
    """Return whether an entry acts on an angle."""
    values = entry.values
    if "coordinate" in values:
        return is_angle(str(values["coordinate"]))
    if "joint" not in values:
        return False
    motions = model.entries["joints"][str(values["joint"])].kind.motions
    return str(values.get("motion") or (*motions, "")[0]) == "angle"


def _numbers(key: str, quantity: Quantity) -> Iterator[tuple[str, Number]]:
    """Yield the numbers that are terms of an expression, with its key."""
    yield from ((key, term) for term in _terms(quantity.root) if isinstance(term, Number))


def _angular(model: Model, node: Node) -> bool:
    """Return whether a term of an expression is an angle of the motion."""
    names = [term.name for term in _terms(node) if isinstance(term, Name)]
    moving = [name for name in names if "." in name or "(" in name]
    return any(Measurement.of(name).unit_in(model) == "rad" for name in moving)


def _terms(node: Node) -> Iterator[Node]:
    """Yield the terms of a sum."""
    match node:
        case Binary(operator="+" | "-"):
            yield from _terms(node.left)
            yield from _terms(node.right)
        case Negative():
            yield from _terms(node.operand)
        case _:
            yield node
