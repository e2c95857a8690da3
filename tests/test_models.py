"""Every example model does what its ``expect:`` block says, and can be read by a person."""

import pytest
from documents import documents

import mbstab
from mbstab.analysis.compare.expectations import check_expectation
from mbstab.model.library import installed_models

MODELS = {path.stem: path for path in installed_models()}


EXPECTATIONS = [
    pytest.param(path, number, id=f"{name}-{number}")
    for name, path in MODELS.items()
    for number in range(len(documents()[name]["expect"]))
]


@pytest.mark.table
@pytest.mark.parametrize(("path", "number"), EXPECTATIONS)
def test_the_expectation_holds(path, number):
    model = mbstab.load(path).model
    outcomes = check_expectation(model, model.expect[number])
    assert outcomes
    assert [f"{o.what}: {o.detail}" for o in outcomes if not o.passed] == []


@pytest.mark.parametrize("name", MODELS)
def test_the_model_says_what_it_is_and_where_it_comes_from(name):
    model = mbstab.load(MODELS[name]).model
    assert len(model.title) > 10
    assert len(model.source) > 30
    assert model.expect
    assert all(expectation.source for expectation in model.expect)
    assert all(parameter.description and parameter.unit for parameter in model.parameters.values())


@pytest.mark.parametrize("name", ["bogie", "car", "rigid_rotor", "robot_arm"])
def test_vehicles_rotors_and_controlled_arms_are_short(name):
    text = MODELS[name].read_text(encoding="utf-8")
    lines = text.splitlines()
    assert len(lines) <= 60
    assert max(map(len, lines)) <= 120
    assert "type: expression" not in text


@pytest.mark.parametrize("name", MODELS)
def test_the_scene_needs_what_it_declares(name):
    model = mbstab.load(MODELS[name])
    report = model.check()
    declared = {e.redundant for e in model.model.expect if e.redundant is not None} or {0}
    assert {len(report.redundant)} == declared
    assert not [item for item in report.unneeded if "is not used" in item]


def test_the_gallery_covers_the_first_four_systems_of_the_paper():
    assert {"pendulum", "wheeled_inverted_pendulum", "top", "rolling_disk"} <= set(MODELS)
