"""Kinds of fields: every field has one, a new one is one class, vectors keep their length; joints in any order."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import pytest

import mbstab
from mbstab.errors import ModelFileError
from mbstab.mechanics.bodies import SHAPES
from mbstab.mechanics.catalogue import ElementUse, Field, Item, Kind
from mbstab.mechanics.elements import KINDS
from mbstab.model.fields.base import FieldKind, Reading
from mbstab.model.fields.catalogue import FIELD_KINDS
from mbstab.model.json_schema import json_schema
from mbstab.model.keys import ALONG, EXPLAINED, MARKER, PART, SECTIONS
from mbstab.model.reader import read_model_text
from mbstab.model.scene import Scene
from mbstab.model.sections.entries import CONSTRAINT_KINDS, MADE_STATE_KIND, STATE_KIND
from mbstab.model.values import evaluate
from mbstab.model.yamlfile import YamlNode

FIELDS = [
    field
    for kind in (
        *(kind for kinds in KINDS.values() for kind in kinds.values()),
        *SHAPES.values(),
        *CONSTRAINT_KINDS.values(),
        STATE_KIND,
        MADE_STATE_KIND,
    )
    for field in kind.fields
]
FIELDS += SECTIONS.values()
FIELDS += [field for fields in (*EXPLAINED.values(), MARKER, PART, (ALONG,)) for field in fields]


def read(text: str) -> Scene:
    return evaluate(read_model_text(f"mbstab: 1\n{text}", "model.yaml"))


def test_every_field_has_a_kind_and_every_kind_a_field() -> None:
    assert {field.shape for field in FIELDS} == set(FIELD_KINDS)


def test_every_kind_describes_its_fields_for_editors() -> None:
    assert all(FIELD_KINDS[field.shape].schema(field) for field in FIELDS)


class TeethField(FieldKind):
    """A whole number of teeth."""

    name = "teeth"

    def read(self, reading: Reading, field: Field, node: YamlNode, path: str) -> int | None:
        return reading.nodes.integer(node, path, 3, 1000, 3)

    def schema(self, field: Field) -> dict[str, Any]:
        return {"type": "integer", "minimum": 3}


def new_kind(monkeypatch: pytest.MonkeyPatch, section: str, kind: Kind) -> None:
    for dimension in kind.dimensions:
        monkeypatch.setitem(KINDS[section], (kind.name, dimension), kind)


BODY = "bodies: {b: {type: planar, mass: 1, inertia: 1}}\n"


def test_a_new_kind_of_field_is_one_class(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(FIELD_KINDS, TeethField.name, TeethField())
    fields = (Field("teeth", "teeth", "how many", required=True),)
    new_kind(monkeypatch, "forces", Kind("gear", "a gear", (2,), fields, lambda item: ()))
    (item,) = read(BODY + "forces: {g: {type: gear, teeth: 17}}").items
    assert item.value("teeth") == 17
    with pytest.raises(ModelFileError, match=r"model\.yaml:3:33: forces\.g\.teeth: expected a whole number between 3"):
        read(BODY + "forces: {g: {type: gear, teeth: 2}}")
    described = json_schema()["properties"]["forces"]["additionalProperties"]["anyOf"][-1]
    assert described["properties"]["teeth"] == {"type": "integer", "minimum": 3, "description": "how many"}


@pytest.mark.parametrize("unit", ["N", "m/s", "N*m", "1", "", "m"])
def test_a_vector_keeps_its_length_whatever_its_unit(monkeypatch: pytest.MonkeyPatch, unit: str) -> None:
    fields = (Field("push", "vector", "a vector", unit, required=True),)
    new_kind(monkeypatch, "forces", Kind("push", "a push", (2,), fields, lambda item: ()))
    scene = read(BODY + "parameters: {P: 30}\nforces: {p: {type: push, push: [0, -P]}, none: {type: push, push: 0}}")
    assert [item.vector("push") for item in scene.items] == [(0.0, -30.0), (0.0, 0.0)]
    assert scene.lengths == ([0.0, 30.0, 0.0, 0.0] if unit == "m" else [])


def test_directions_in_ground_axes_have_length_one_and_may_be_named() -> None:
    scene = read(
        BODY + "ground: {directions: {uphill: [-3, 4]}}\ncontacts: {c: {type: disk, center: b, radius: 1, normal: "
        "uphill}}\ndrives: {d: {type: point, at: b, direction: -y, position: 0}}"
    )
    assert [scene.items[0].direction("normal"), scene.items[1].direction("direction")] == [(-0.6, 0.8), (0.0, -1.0)]


# --- names of joints ------------------------------------------------------------------------------------------------


def _lock(item: Item) -> Iterable[ElementUse]:
    first, second = item.joint("joint").markers("between")
    yield ElementUse("aligned", (first.body, second.body), (0.0,), labels=("lock",))


@pytest.fixture
def lock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A joint that locks another one."""
    fields = (Field("joint", "joint", "the joint to lock", required=True),)
    new_kind(monkeypatch, "joints", Kind("lock", "locks a joint", (2,), fields, _lock, motions=("angle",)))


JOINTS = {
    "hinge": "{type: revolute, between: [b, ground]}",
    "rail": "{type: point_on_line, between: [ground, c], axis: x}",
    "lock": "{type: lock, joint: hinge}",
}
BODIES = "bodies: {b: {type: planar, mass: 1, inertia: 1}, c: {type: planar, mass: 1, inertia: 1}}\n"


@pytest.mark.usefixtures("lock")
@pytest.mark.parametrize("order", list(itertools.permutations(JOINTS)), ids=" ".join)
def test_a_joint_may_name_another_in_any_order(order: tuple[str, ...]) -> None:
    joints = "".join(f"  {name}: {JOINTS[name]}\n" for name in order)
    force = "forces: {spring: {type: joint_spring, joint: hinge, stiffness: 2}}\n"
    mechanism = mbstab.loads(f"mbstab: 1\n{force}{BODIES}joints:\n{joints}")
    assert mechanism.check().degrees_of_freedom == 2
    items = {item.name: item for item in mechanism.system().scene.items}
    assert items["lock"].joint("joint") is items["spring"].joint("joint") is items["hinge"]
    assert items["lock"].points_acted_on() == items["hinge"].points()


@pytest.mark.usefixtures("lock")
@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (f"lock: {{type: lock, joint: hing}}, hinge: {JOINTS['hinge']}", ("3:36", "no joint 'hing'", "mean 'hinge'?")),
        ("lock: {type: lock, joint: lock}", ("3:36", "in a circle: lock → lock", "another joint")),
        (
            "one: {type: lock, joint: two}, two: {type: lock, joint: one}",
            ("3:66", "in a circle: one → two → one", "another joint"),
        ),
    ],
    ids=["unknown", "itself", "circle"],
)
def test_a_joint_that_is_not_there_or_needs_itself_is_refused(joints: str, said: tuple[str, str, str]) -> None:
    place, message, hint = said
    with pytest.raises(ModelFileError) as caught:
        read(f"{BODY}joints: {{{joints}}}")
    (problem,) = caught.value.problems
    assert str(problem.location) == f"model.yaml:{place}"
    assert message in problem.message
    assert hint in problem.hint


@pytest.mark.usefixtures("lock")
def test_a_joint_of_the_wrong_kind_is_refused_wherever_it_stands() -> None:
    with pytest.raises(ModelFileError, match=r"model\.yaml:3:36: .*a spherical joint has no single angle or travel"):
        read(f"{BODY}joints: {{lock: {{type: lock, joint: ball}}, ball: {{type: spherical, between: [b, ground]}}}}")


@pytest.mark.usefixtures("lock")
def test_a_joint_with_a_problem_is_no_second_problem_where_it_is_named() -> None:
    with pytest.raises(ModelFileError) as caught:
        read(f"{BODY}joints: {{lock: {{type: lock, joint: hinge}}, hinge: {{type: revolut, between: [b, ground]}}}}")
    (problem,) = caught.value.problems
    assert "unknown type 'revolut'" in problem.message


def test_every_stiffness_and_damping_that_must_not_be_negative_says_what_to_write_instead() -> None:
    units = {"N/m", "N*s/m", "N*m/rad", "N*m*s/rad"}
    stiff = [x for x in FIELDS if x.sign == "nonnegative" and units & {x.unit, *x.units}]
    assert len({x.name for x in stiff}) >= 6
    assert all(x.instead for x in stiff)
    springs = [x for x in stiff if x.name != "aligning_stiffness"]
    assert all("type expression: on: {body.x: 2000*rate(body.x)}" in x.instead for x in springs)


def test_what_to_write_instead_of_a_negative_coefficient_is_told_and_works() -> None:
    model = "bodies: {body: {type: planar_point, mass: 1}}\nforces:\n  f: {%s}"
    with pytest.raises(ModelFileError, match=r"cxx must not be negative, got -2 N\*s/m\n(.*\n)*hint: .*cyx may be"):
        read(model % "type: rotor_bearing, between: [body, ground], cxx: -2")
    read(model % "type: expression, on: {body.x: 2000*rate(body.x)}")
