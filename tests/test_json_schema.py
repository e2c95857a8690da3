"""The JSON Schema for editors accepts what the reader accepts, and explains every key."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from mbstab.mechanics.bodies import SHAPES
from mbstab.mechanics.elements import KINDS
from mbstab.model.json_schema import json_schema
from mbstab.model.keys import SECTIONS

ROOT = Path(__file__).parents[1]
FILES = [
    path
    for folder in ("models", "mbstab/model/starts", "tests/scenes")
    for path in sorted((ROOT / folder).glob("*.yaml"))
]
SCHEMA = json_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def as_an_editor_reads(text: str) -> Any:
    """Return what YAML 1.2 makes of a text: numbers, words, true and false; YAML 1.1 makes True of the key ``on``."""

    def resolved(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: resolved(item) for key, item in value.items()}
        if isinstance(value, list):
            return [resolved(item) for item in value]
        if value in ("true", "false"):
            return value == "true"
        for number in (int, float):
            try:
                return number(value)
            except ValueError:
                pass
        return value

    return resolved(yaml.load(text, yaml.BaseLoader))


def is_accepted(text: str) -> bool:
    return VALIDATOR.is_valid(as_an_editor_reads(text))


def test_it_is_a_json_schema_and_json() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert json.loads(json.dumps(SCHEMA)) == SCHEMA


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_model_of_the_project_is_accepted(path: Path) -> None:
    VALIDATOR.validate(as_an_editor_reads(path.read_text(encoding="utf-8")))


BODY = "bodies: {b: {type: planar, mass: 1, inertia: 1}}\n"
GOOD = f"mbstab: 1\n{BODY}"


@pytest.mark.parametrize(
    "text",
    [
        BODY,
        "mbstab: 1",
        f"mbstab: 2\n{BODY}",
        GOOD + "jonts: {}",
        GOOD + "gravity: 9.81",
        "mbstab: 1\nbodies: {b: {type: planar, masss: 1, inertia: 1}}",
        "mbstab: 1\nbodies: {b: {type: plane, mass: 1, inertia: 1}}",
        "mbstab: 1\nbodies: {b: {mass: 1, inertia: 1}}",
        "mbstab: 1\nbodies: {b: {type: planar, mass: [1], inertia: 1}}",
        "mbstab: 1\nbodies: {b: {type: planar, mass: 1, shape: {type: rod, radius: 1}}}",
        "mbstab: 1\nbodies: {b: {type: planar, mass: 1, shape: {type: sphere}}}",
        "mbstab: 1\nbodies: {b: {type: planar, parts: [{type: sphere, radius: 1}]}}",
        GOOD + "parameters: {a: {value: 1, units: m}}",
        GOOD + "joints: {j: {type: revolute}}",
        GOOD + "joints: {j: {type: revolute, between: [b]}}",
        GOOD + "joints: {j: {type: revolute, between: [b, {point: [1, 0]}]}}",
        GOOD + "contacts: {c: {type: disk, center: b, radius: 1, motion: roling}}",
        GOOD + "constraints: {c: {scleronomic: b.x}}",
        GOOD + "reference: {speeds: {}}",
        GOOD + "reference: {find: equilibria}",
        GOOD + "initial: {speeds: {}}",
        GOOD + "initial: {time: [1]}",
        GOOD + "reference: {steady: {axis: z, rates: 3}}",
        GOOD + "reference: {steady: {direction: x, speed: [1]}}",
        GOOD + "reference: {period: [1]}",
        GOOD + "expect: [{frozen: 1}]",
        GOOD + "sweep: {a: {from: 1}}",
        GOOD + "expect: [{verdict: steady}]",
        GOOD + "expect: [{critical: {parameter: a, value: 1}}]",
    ],
)
def test_a_file_with_a_wrong_key_or_value_is_not_accepted(text: str) -> None:
    assert is_accepted(GOOD)
    assert not is_accepted(text)


def test_a_misspelled_key_is_accepted_nowhere() -> None:
    for path in FILES:
        model = as_an_editor_reads(path.read_text(encoding="utf-8"))
        for mapping in closed_mappings(model):
            mapping["mispelled"] = 1
            assert not VALIDATOR.is_valid(model), f"{path.name}: {mapping}"
            del mapping["mispelled"]


def closed_mappings(model: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the mappings whose keys the format fixes: not those whose keys are names."""
    yield model
    for section in ("bodies", "joints", "contacts", "drives", "forces", "constraints", "sweep"):
        for entry in model.get(section, {}).values():
            yield entry
            yield from (entry[key] for key in ("shape",) if key in entry)
            yield from entry.get("parts", [])
    yield from (value for value in model.get("parameters", {}).values() if isinstance(value, dict))
    yield from (model[key] for key in ("ground", "reference", "initial") if key in model)
    yield from (model["reference"][key] for key in ("steady",) if key in model.get("reference", {}))
    for expectation in model.get("expect", []):
        yield expectation
        yield from (expectation[key] for key in ("critical",) if key in expectation)
        yield from expectation.get("eigenvalues", [])


def properties(node: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield every key that the schema names, with its schema."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        if key == "properties":
            yield from value.items()
            yield from properties(list(value.values()))
        elif isinstance(value, dict | list):
            yield from properties(value)


def test_every_key_has_a_description() -> None:
    found = list(properties(SCHEMA))
    assert {name for name, node in found if not node.get("description")} == set()
    assert {name for name, _ in found} > {"mbstab", "joints", "axis", "stiffness", "radius", "along", "imag", "above"}


@pytest.mark.parametrize("section", KINDS)
def test_every_field_of_every_kind_is_described_with_its_unit(section: str) -> None:
    entries = SCHEMA["properties"][section]["additionalProperties"]["anyOf"]
    kinds = {id(kind): kind for kind in KINDS[section].values()}.values()
    assert len(entries) == len(kinds)
    for kind, entry in zip(kinds, entries, strict=True):
        assert entry["properties"]["type"]["const"] == kind.name
        assert entry["description"] == kind.doc != ""
        fields = [field for field in kind.fields if not field.made]
        assert set(entry["properties"]) == {"type", *(field.name for field in fields)}
        for field in fields:
            description = entry["properties"][field.name]["description"]
            assert field.doc in description
            assert len(field.doc) > 1
            assert field.unit in ("", "1") or description.endswith(f"({field.unit})")


def test_every_shape_is_in_the_schema_with_its_own_lengths() -> None:
    body = next(
        entry
        for entry in SCHEMA["properties"]["bodies"]["additionalProperties"]["anyOf"]
        if entry["properties"]["type"]["const"] == "spatial"
    )
    shapes = {shape["properties"]["type"]["const"]: shape for shape in body["properties"]["shape"]["anyOf"]}
    assert set(shapes) == set(SHAPES)
    for name, kind in SHAPES.items():
        along = {"along"} if kind.axis is not None else set()
        assert set(shapes[name]["properties"]) == {"type", *along, *(field.name for field in kind.fields)}


def test_every_section_of_a_file_is_in_the_schema() -> None:
    assert list(SCHEMA["properties"]) == list(SECTIONS)
