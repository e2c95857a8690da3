"""The JSON Schema of model files, for editors."""

from __future__ import annotations

from typing import Any

from mbstab.mechanics.elements import KINDS
from mbstab.model.fields.catalogue import describe_field, object_schema, typed_schema
from mbstab.model.fields.mappings import by_name
from mbstab.model.keys import SECTIONS


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of model files."""
    properties = {name: describe_field(x) for name, x in SECTIONS.items() if name not in KINDS}
    properties |= {name: {**by_name({"anyOf": _types(name)}), "description": SECTIONS[name].doc} for name in KINDS}
    block = object_schema(SECTIONS["repeat"].keys)
    block["properties"] |= {name: properties[name] for name, x in SECTIONS.items() if not x.once and name != "needs"}
    properties["repeat"] = {**properties["repeat"], "items": block}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mbstab model",
        "type": "object",
        "properties": {name: properties[name] for name in SECTIONS},
        "required": ["mbstab"],
        "anyOf": [{"required": [key]} for key in ("bodies", "repeat", "include", "needs")],
        "additionalProperties": False,
    }


def _types(section: str) -> list[dict[str, Any]]:
    """Return the schema of every type of a section."""
    kinds = {id(kind): kind for kind in KINDS[section].values()}.values()
    return [typed_schema(kind.name, kind.doc, kind.fields) for kind in kinds]
