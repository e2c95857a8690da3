"""Types of bodies, joints, contacts, drives and forces as text, for people who write a model file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from mbstab.mechanics.bodies import SHAPES
from mbstab.mechanics.catalogue import Field, Kind
from mbstab.model.fields.catalogue import kind_of
from mbstab.model.keys import ALONG, PART
from mbstab.report.tables import wrap_lines

SCENES = {(2,): "planar scenes", (3,): "spatial scenes", (2, 3): "all scenes"}


def kinds_text(kinds: Sequence[Kind]) -> str:
    """Return the description and the keys of each type."""
    lines: list[str] = []
    for kind in kinds:
        lines += wrap_lines(f"{kind.name}: {kind.doc} ({SCENES[kind.dimensions]})", "", "  ")
        for field in (field for field in kind.fields if not field.made):
            lines += wrap_lines(_field(field), "  ", "      ")
        lines.append("")
    return "\n".join(lines)


def shapes_text() -> str:
    """Return the shapes of bodies and of their parts, with their keys."""
    lines: list[str] = []
    for kind in SHAPES.values():
        lines += wrap_lines(f"{kind.name}: {kind.doc}", "", "  ")
        along = [] if kind.axis is None else [replace(ALONG, default="xyz"[kind.axis])]
        for field in (*kind.fields, *along):
            lines += wrap_lines(_field(field), "  ", "      ")
        lines.append("")
    lines.append("entries of parts: have besides (those of drawing only: at)")
    for field in PART:
        lines += wrap_lines(f"{field.name}: {field.text}", "  ", "      ")
    return "\n".join(lines) + "\n"


def keys_text(keys: Iterable[Field]) -> str:
    """Return the keys of a section without types, with their meaning."""
    lines: list[str] = []
    for field in keys:
        lines += wrap_lines(f"{field.name}: {field.text}", "", "    ")
    return "\n".join(lines) + "\n"


def _field(field: Field) -> str:
    notes = [f"unit {field.unit}" if field.unit not in ("", "1") else "", "required" if field.required else ""]
    if field.default is not None:
        notes.append(f"default {field.default}")
    if explained := kind_of(field).explained:
        notes.append(f"see mbstab schema {explained}")
    if field.choices:
        notes.append("one of " + ", ".join(field.choices))
    if field.dimensions != (2, 3):
        notes.append(SCENES[field.dimensions])
    said = "; ".join(note for note in notes if note)
    return f"{field.name}: {field.doc}" + (f" [{said}]" if said else "")
