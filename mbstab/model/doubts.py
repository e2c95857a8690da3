"""What a file may say and most likely does not mean."""

from __future__ import annotations

from mbstab.model.bare_degrees import bare_degrees
from mbstab.model.dependencies import equations_of, expressions_in
from mbstab.model.expressions import Number
from mbstab.model.numbers import is_extreme
from mbstab.model.schema import Entry, Model, Quantity


def doubts(model: Model) -> list[str]:
    """Return warnings about a model: sums of unlike terms, numbers that look like degrees, wheels that do not mesh."""
    return model.document.doubts + bare_degrees(model) + loose_trains(model)


def extreme_numbers(model: Model) -> list[str]:
    """Return the numbers of a model whose powers leave the range of double precision, each with its place."""
    found = [
        f"{name}={x.given.setting}" for name, x in model.parameters.items() if x.given and is_extreme(x.given.setting)
    ]
    written = [x.expression for x in model.parameters.values() if x.given is None]
    for quantity in expressions_in([written, equations_of(model), model.reference]):
        if isinstance(quantity, Quantity):
            numbers = [node.text for node in quantity.walk() if isinstance(node, Number) and is_extreme(node.text)]
            found += [f"{text} in {quantity.path} ({quantity.location})" for text in numbers]
    return list(dict.fromkeys(found))[:3]


def loose_trains(model: Model) -> list[str]:
    """Return warnings about drive trains whose joints share no body.

    Their equations hold, with a moment on all bodies of the joints, as of a cable in sheaths: no wheel rolls on another
    one. Bodies that fixed joints hold together count as one, where all joints turn against it.
    """
    trains = [entry for entry in model.entries["joints"].values() if "joints" in entry.values]
    if not trains:
        return []
    together = _together(model)
    found = []
    for train in trains:
        pairs = [_bodies(model.entries["joints"][name]) for name in train.values["joints"]]
        carriers = {together.get(second, second) for _, second in pairs}
        if len(carriers) > 1 and not set.intersection(*map(set, pairs)):
            *names, last = (repr(name) for name in train.values["joints"])
            found.append(
                f"{train.called}: the joints {', '.join(names)} and {last} have no body in common; their motions are "
                "coupled as by a cable, not by wheels in mesh\n"
                "hint: let each joint join its wheel or rack, the first body, to the one body that carries all of them"
            )
    return found


def _bodies(joint: Entry) -> tuple[str | None, ...]:
    """Return the names of the bodies of a joint, None for the ground."""
    return tuple(marker.body for marker in joint.values["between"])


def _together(model: Model) -> dict[str | None, str | None]:
    """Return for each body that fixed joints hold to others one of these, the same for all."""
    root: dict[str | None, str | None] = {}
    for joint in model.entries["joints"].values():
        if joint.kind.name == "fixed":
            one, other = (root.get(body, body) for body in _bodies(joint))
            root |= {body: other for body, known in root.items() if known == one} | {one: other, other: other}
    return root
