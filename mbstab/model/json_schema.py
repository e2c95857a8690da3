"""The JSON Schema of model files, for editors."""

from __future__ import annotations

from typing import Any

from mbstab.mechanics.catalogue import Kind
from mbstab.mechanics.elements import KINDS
from mbstab.model.expansion import ONLY_ONCE
from mbstab.model.fields.base import BY_NAME, DIRECTION, NUMBER, TEXT, VECTOR, described, object_schema, typed_schema
from mbstab.model.fields.catalogue import kind_of
from mbstab.model.schema import (
    CONSTRAINT_FIELDS,
    CRITICAL_FIELDS,
    EIGENVALUE_FIELDS,
    EXPECT_FIELDS,
    FINDS,
    GEOMETRY_FIELDS,
    INCLUDE_FIELDS,
    INITIAL_FIELDS,
    MODE_FIELDS,
    PARAMETER_FIELDS,
    REFERENCE_FIELDS,
    REPEAT_FIELDS,
    SECTIONS,
    SIGNS,
    STATE_FIELDS,
    STEADY_FIELDS,
    SWEEP_FIELDS,
    TABLE_FIELDS,
    VERSION,
)
from mbstab.model.words import WORDS

INTEGER = {"type": "integer"}
STATE = {"type": "object", "additionalProperties": {"anyOf": [BY_NAME, NUMBER]}}


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of model files."""
    column = {"anyOf": [TEXT, {"type": "array", "items": {"type": "number"}}]}
    include = object_schema(INCLUDE_FIELDS, file=TEXT, prefix=TEXT, **{"with": _by_name(NUMBER)})
    properties: dict[str, Any] = {
        "mbstab": {"const": int(VERSION)},
        "title": TEXT,
        "source": TEXT,
        "counts": _by_name({"anyOf": [INTEGER, TEXT]}),
        "repeat": {"type": "array", "items": {"type": "object"}},
        "include": {"type": "array", "items": {**include, "required": ["file"]}},
        "needs": _by_name(TEXT),
        "parameters": {"type": "object", "additionalProperties": {"anyOf": [NUMBER, _parameter()]}},
        "tables": _by_name({**object_schema(TABLE_FIELDS, x=column, y=column, file=TEXT)}),
        "definitions": BY_NAME,
        "gravity": VECTOR,
        "ground": object_schema(GEOMETRY_FIELDS, points=_by_name(VECTOR), directions=_by_name(DIRECTION)),
        **{name: _by_name({"anyOf": _kinds(name)}) for name in KINDS},
        "constraints": _by_name(object_schema(CONSTRAINT_FIELDS, holonomic=TEXT, nonholonomic=TEXT)),
        "states": _by_name({**object_schema(STATE_FIELDS, rate=NUMBER, unit=TEXT), "required": ["rate"]}),
        "outputs": _by_name(TEXT),
        "reference": _reference(),
        "initial": object_schema(INITIAL_FIELDS, time=NUMBER, coordinates=STATE, rates=STATE),
        "sweep": _by_name(_sweep()),
        "modes": _by_name(object_schema(MODE_FIELDS, near=NUMBER, shape=BY_NAME, at=BY_NAME)),
        "expect": {"type": "array", "items": _expectation()},
    }
    properties = {key: {**node, "description": SECTIONS[key]} for key, node in properties.items()}
    block = {key: node for key, node in properties.items() if key not in (*ONLY_ONCE, "needs")}
    ends = {"type": "array", "items": {"anyOf": [INTEGER, TEXT]}, "minItems": 2, "maxItems": 2}
    block["for"] = {**_by_name(ends), "description": REPEAT_FIELDS["for"]}
    one = {"type": "object", "properties": block, "required": ["for"], "additionalProperties": False}
    properties["repeat"] = {**properties["repeat"], "items": one}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mbstab model",
        "type": "object",
        "properties": properties,
        "required": ["mbstab"],
        "anyOf": [{"required": [key]} for key in ("bodies", "repeat", "include", "needs")],
        "additionalProperties": False,
    }


def _by_name(node: Any) -> dict[str, Any]:
    return {"type": "object", "additionalProperties": node}


def _kinds(section: str) -> list[dict[str, Any]]:
    """Return the schema of every type of a section."""
    return [_kind(kind) for kind in {id(kind): kind for kind in KINDS[section].values()}.values()]


def _kind(kind: Kind) -> dict[str, Any]:
    properties = {field.name: described(kind_of(field), field) for field in kind.fields if not field.made}
    return typed_schema(kind.name, kind.doc, properties, [field.name for field in kind.fields if field.required])


def _parameter() -> dict[str, Any]:
    sign = {"enum": list(SIGNS)}
    found = object_schema(PARAMETER_FIELDS, value=NUMBER, unit=TEXT, sign=sign, description=TEXT)
    return {**found, "required": ["value"]}


def _reference() -> dict[str, Any]:
    return object_schema(
        REFERENCE_FIELDS,
        time=NUMBER,
        coordinates=STATE,
        rates=STATE,
        guess={**STATE, "properties": {"rates": {**STATE, "description": "guesses of rates, with find: steady"}}},
        find={"enum": list(FINDS)},
        steady=object_schema(
            STEADY_FIELDS, axis=DIRECTION, rate=NUMBER, point=VECTOR, direction=DIRECTION, speed=NUMBER
        ),
        period=NUMBER,
        closure_tolerance=NUMBER,
    )


def _sweep() -> dict[str, Any]:
    found = object_schema(SWEEP_FIELDS, **{"from": NUMBER, "to": NUMBER, "points": INTEGER})
    return {**found, "required": ["from", "to"]}


def _expectation() -> dict[str, Any]:
    verdict = {"enum": list(WORDS)}
    critical = object_schema(
        CRITICAL_FIELDS, parameter=TEXT, value=NUMBER, tolerance=NUMBER, below=verdict, above=verdict
    )
    return object_schema(
        EXPECT_FIELDS,
        at=BY_NAME,
        eigenvalues={"type": "array", "items": object_schema(EIGENVALUE_FIELDS, real=NUMBER, imag=NUMBER)},
        tolerance=NUMBER,
        neutral=INTEGER,
        frozen={"type": "boolean"},
        coordinates=STATE,
        redundant=INTEGER,
        verdict=verdict,
        critical={**critical, "required": ["parameter", "value", "below", "above"]},
        source=TEXT,
    )
