"""Entries with states of their own: what they stand for, from the texts of their keys."""

from __future__ import annotations

from typing import Any

from mbstab.mechanics.catalogue import Kind, Part
from mbstab.model import units
from mbstab.model.expressions import ExpressionError
from mbstab.model.fields.base import Reading
from mbstab.model.fields.catalogue import kind_of
from mbstab.model.measures import effort_unit
from mbstab.model.schema import Quantity
from mbstab.model.yamlfile import Mapping, Scalar, Sequence, YamlNode


def _texts(node: YamlNode) -> Any:
    if isinstance(node, Scalar):
        return node.text
    if isinstance(node, Sequence):
        return [_texts(item) for item in node.items]
    return {key: _texts(item) for key, item in node.entries.items()}


def _along(node: Mapping, motions: tuple[str, ...]) -> str:
    given = {key: item.text for key, item in node.entries.items() if isinstance(item, Scalar)}
    if "coordinate" in given:
        return given["coordinate"]
    return f"{given.get('motion', (*motions, '')[0])}({given.get('joint', '')})"


def part_of(kind: Kind, name: str, node: Mapping, motions: tuple[str, ...] = ()) -> Part:
    """Return what an entry stands for.

    Parameters
    ----------
    motions : tuple of str
        Motions of the joint that it names.

    Raises
    ------
    PartError, KeyError, TypeError, ValueError
        If its keys do not fit each other, are missing or of another form.
    """
    assert kind.part is not None
    given = {key: _texts(item) for key, item in node.entries.items()}
    return kind.part(_along(node, motions), name, given)


GAINS = {"P": 0, "I": -1, "D": 1, "target": 0}
"""Gains of a `pid`: the power of seconds that they have besides what they multiply; its target is measured alike."""


def _check_gains(reading: Reading, kind: Kind, effort: str) -> None:
    """Refuse gains that do not make an effort of what they multiply, as far as units are declared."""
    values = reading.values
    if kind.name == "pid":
        for key, seconds in GAINS.items():
            if key in values:
                _check_gain(reading, values[key], values["of"], effort if key != "target" else "", seconds)
    elif kind.name == "state_feedback":
        half = len(values["gains"]) // 2
        for signal, gain in zip(values["gains"][:half], values["gains"][half:], strict=True):
            _check_gain(reading, gain, signal, effort, 0)


def _check_gain(reading: Reading, gain: Quantity, signal: Quantity, effort: str, seconds: int) -> None:
    """Refuse a gain that is not an effort per signal; without an effort, what is not the same as the signal."""
    quantities = reading.quantities
    try:
        found, of = quantities.dimension_of(gain), quantities.dimension_of(signal)
        expected = units.per(effort or "1", of, seconds)
        if not effort and expected is not None:
            expected = units.inverse(expected)
    except ExpressionError:
        return  # told where it was read
    if expected is None or isinstance(found, (str, units.Moving)) or found == expected:
        return
    unit = quantities.unit_of(signal.text)
    below = f"({unit}*s)" if seconds < 0 else unit
    wanted = f"{effort}{'*s' * (seconds > 0)}/{below}" if effort else unit
    message = f"{gain.text!r} has the unit {units.show(found)}, expected {wanted if unit else units.show(expected)}"
    hint = f"it multiplies {signal.text}" if effort else f"it is compared with {signal.text}"
    reading.nodes.complain(gain.location, gain.path, message, hint)


def write_effort(reading: Reading, kind: Kind, name: str, node: Mapping) -> Part | None:
    """Give an entry its effort along the motion it acts on; return what it stands for, None after a problem."""
    asked = {field.name for field in kind.fields if field.required}
    if not asked <= set(reading.values) or len({"joint", "coordinate"} & set(reading.values)) != 1:
        return None
    motions = reading.joint.motions if reading.joint is not None else ()
    along, part = _along(node, motions), part_of(kind, name, node, motions)
    at = node.location
    loads = Mapping({along: Scalar(part.effort, at)}, {along: Scalar(along, at)}, at)
    told = len(reading.nodes.document.problems)
    _check_gains(reading, kind, effort_unit(reading.quantities.unit_of(along)))
    if len(reading.nodes.document.problems) > told:
        return None
    field = kind.field("on")
    reading.read(kind_of(field), field, loads)
    return part
