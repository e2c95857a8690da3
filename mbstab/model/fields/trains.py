"""Fields of drive trains: the joints that they connect, and the ratio between them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from mbstab.mechanics.catalogue import Field, Number
from mbstab.mechanics.gears import SMALL, nearest_whole, whole_turns
from mbstab.model.fields.base import NUMBER, TEXT, FieldKind, Owner, Reading
from mbstab.model.fields.values import NumberField
from mbstab.model.nodes import decimal_commas
from mbstab.model.numbers import all_of, nominal
from mbstab.model.schema import Components, Quantity
from mbstab.model.yamlfile import Sequence, YamlNode


class JointsField(FieldKind):
    """Names of different joints, wherever they stand in the file; `Field.motions` are the motions they must have."""

    name = "joints"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> tuple[str, ...] | None:
        """Return the names."""
        count = len(field.motions)
        if not isinstance(node, Sequence) or len(node.items) != count:
            reading.nodes.complain(node, path, f"expected a list of {count} joints", field.doc)
            return None
        found: list[str] = []
        for i, (item, motion) in enumerate(zip(node.items, field.motions, strict=True)):
            place = f"{path}[{i}]"
            word = reading.nodes.word(item, place, "the name of a joint")
            kind = reading.names.joint(item, place, word) if word is not None else None
            if word is None or kind is None:
                continue
            if motion not in kind.motions:
                only = f", only {kind.motions[0]}" if kind.motions else ""
                hint = f"here stands a joint that has the motion {motion}: {field.doc}"
                reading.nodes.complain(item, place, f"the {kind.name} joint {word!r} has no {motion}{only}", hint)
            elif word in found:
                reading.nodes.complain(item, place, f"the joint {word!r} stands here twice", field.doc)
            else:
                found.append(word)
        return tuple(found) if len(found) == count else None

    def numbers(self, owner: Owner, field: Field, value: tuple[str, ...]) -> tuple[Any, ...]:
        """Return the joints, each an `Item`."""
        return tuple(map(owner.joint_named, value))

    def joints(self, value: tuple[str, ...]) -> Iterable[str]:
        """Return the names."""
        return value

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a list of names."""
        count = len(field.motions)
        return {"type": "array", "items": TEXT, "minItems": count, "maxItems": count}


class RatioField(NumberField):
    """A ratio of turns; in space, where angles do not count turns, a fraction of small whole numbers."""

    name = "ratio"

    def check(self, owner: Owner, field: Field, numbers: Number, time: Number) -> None:
        """Refuse in space what is no such fraction."""
        check_ratio(owner, numbers, owner.entry.values[field.name])


class RadiiField(FieldKind):
    """Two lengths, of which in space one is the other times a fraction of small whole numbers."""

    name = "radii"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> Components | None:
        """Return both."""
        if not isinstance(node, Sequence) or len(node.items) != 2:
            hint = (decimal_commas(node, 2) if isinstance(node, Sequence) else "") or field.doc
            reading.nodes.complain(node, path, "expected a list of two numbers, one for each wheel", hint)
            return None
        return reading.quantities.components(node.items, node, path, field.unit)

    def numbers(self, owner: Owner, field: Field, value: Components) -> tuple[Number, ...]:
        """Return both numbers; each has the sign that the field asks for."""
        return tuple(owner.evaluator.number(x, field) for x in value.values)

    def check(self, owner: Owner, field: Field, numbers: tuple[Number, ...], time: Number) -> None:
        """Refuse in space a quotient that is no such fraction."""
        check_ratio(owner, numbers[1] / numbers[0], owner.entry.values[field.name])

    def schema(self, field: Field) -> dict[str, Any]:
        """Return the schema of a list of two numbers."""
        return {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2}


class TeethField(RadiiField):
    """Two numbers of teeth."""

    name = "teeth"

    def check(self, owner: Owner, field: Field, numbers: tuple[Number, ...], time: Number) -> None:
        """Require positive whole numbers."""
        for number, quantity in zip(numbers, owner.entry.values[field.name].values, strict=True):
            if not owner.evaluator.symbolic and not (all_of(number > 0) and _is_whole(number)):
                message = f"a number of teeth must be whole and positive, got {nominal(number):g}"
                owner.evaluator.complain(quantity, message, "a ratio that is no quotient of teeth is written as ratio:")


def _is_whole(number: Number) -> bool:
    off = number - nearest_whole(number)
    return all_of(off <= 0) and all_of(off >= 0)


def check_ratio(owner: Owner, ratio: Number, written: Quantity | Components) -> None:
    """Record a problem with a ratio that wheels in space cannot have."""
    evaluator = owner.evaluator
    if evaluator.model.dimension == 3 and not evaluator.symbolic and whole_turns(ratio) is None:
        message = (
            f"in space a ratio must be a fraction with a number up to {SMALL} above or below, "
            f"got {nominal(ratio):.12g}: angles of joints do not count turns there"
        )
        one, other = (f"rate(angle({name}))" for name in owner.entry.values["joints"][:2])
        hint = f"{{nonholonomic: {one} + ratio*{other}}}, which leaves it open where the wheels stand in mesh"
        evaluator.complain(
            written, message, f"give the numbers of teeth, teeth: [n1, n2]; or couple the rates by a constraint, {hint}"
        )
