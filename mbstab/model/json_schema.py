"""The JSON Schema of model files, for editors."""

from __future__ import annotations

from typing import Any

from mbstab.model.fields.catalogue import describe_field, object_schema
from mbstab.model.keys import SECTIONS


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of model files."""
    properties = {name: describe_field(section) for name, section in SECTIONS.items()}
    block = object_schema(SECTIONS["repeat"].keys)
    block["properties"] |= {name: properties[name] for name, x in SECTIONS.items() if not x.once and name != "needs"}
    properties["repeat"] = {**properties["repeat"], "items": block}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mbstab model",
        "type": "object",
        "properties": properties,
        "required": ["mbstab"],
        "anyOf": [{"required": [key]} for key in ("bodies", "repeat", "include", "needs")],
        "additionalProperties": False,
    }
