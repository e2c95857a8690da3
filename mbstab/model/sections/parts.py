"""Entries with states of their own: what they stand for, from the texts of their keys."""

from __future__ import annotations

from typing import Any

from mbstab.mechanics.catalogue import Kind, Part
from mbstab.model.fields.base import Reading
from mbstab.model.fields.catalogue import kind_of
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


def write_effort(reading: Reading, kind: Kind, name: str, node: Mapping) -> Part | None:
    """Give an entry its effort along the motion it acts on; return what it stands for, None after a problem."""
    asked = {field.name for field in kind.fields if field.required}
    if not asked <= set(reading.values) or len({"joint", "coordinate"} & set(reading.values)) != 1:
        return None
    motions = reading.joint.motions if reading.joint is not None else ()
    along, part = _along(node, motions), part_of(kind, name, node, motions)
    at = node.location
    loads = Mapping({along: Scalar(part.effort, at)}, {along: Scalar(along, at)}, at)
    field = kind.field("on")
    reading.read(kind_of(field), field, loads)
    return part
