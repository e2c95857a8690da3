"""Energies and powers at the reference: closed forms, and the balance that the equations of motion keep."""

import json

import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli.main import main

DRIVEN = """\
mbstab: 1
gravity: [0, -10]
bodies:
  rod: {type: planar, mass: 2, inertia: 0.3, points: {O: [-0.5, 0]}}
joints: {pivot: {type: revolute, between: [rod.O, ground]}}
drives: {motor: {type: joint, joint: pivot, velocity: 3}}
forces:
  brake: {type: joint_spring, joint: pivot, stiffness: 4, damping: 0.5}
  fan: {type: torque, body: rod, value: -0.1}
reference: {coordinates: {rod: {theta: 0.2}}, rates: {rod: {theta: 3}}}
"""


def test_a_driven_rod_has_the_energies_of_textbooks():
    found = mbstab.loads(DRIVEN).energies()
    height = 0.5 * 0.19866933079506122
    shares = {x.owner: (x.kinetic, x.potential, x.power) for x in found.shares}
    assert list(shares) == ["body 'rod'", "drive 'motor'", "force 'brake'", "force 'fan'"]
    assert shares["body 'rod'"] == pytest.approx((0.5 * (0.3 + 2 * 0.25) * 9, 2 * 10 * height, 0))
    assert shares["force 'brake'"] == pytest.approx((0, 0.5 * 4 * 0.04, -0.5 * 9))
    assert shares["force 'fan'"] == pytest.approx((0, 0, -0.3))
    # At a constant rate the kinetic energy stays: the sum of the powers is what lifts and winds.
    lifted = 2 * 10 * 0.5 * 0.9800665778412416 * 3
    assert found.total.power == pytest.approx(lifted + 4 * 0.2 * 3)
    assert shares["drive 'motor'"][2] == pytest.approx(lifted + 4 * 0.2 * 3 + 4.5 + 0.3)


def test_the_sum_of_powers_is_the_rate_of_the_energy_in_a_simulation():
    model = mbstab.loads(DRIVEN)
    sim = model.simulate(1e-3, points=3, tol=1e-10)
    energy = sim.kinetic + sim.potential
    rate = (-3 * energy[0] + 4 * energy[1] - energy[2]) / 1e-3
    assert rate == pytest.approx(model.energies().total.power, rel=1e-5)


def test_a_steady_motion_keeps_its_energy():
    found = mbstab.load("governor.yaml").energies()
    assert abs(found.total.power) < 1e-12 * found.total.kinetic


@pytest.mark.parametrize("name", ["governor", "rolling_disk"])
def test_power_that_is_rounding_is_zero(name):
    found = mbstab.load(f"{name}.yaml").energies()
    (drive,) = (x for x in found.shares if x.owner.startswith("drive"))
    assert drive.power == found.total.power == 0.0 < drive.power_error < 1e-10


def test_a_weak_power_beside_strong_ones_is_told():
    (weak,) = (x for x in mbstab.loads(DRIVEN.replace("-0.1", "-1e-30")).energies().shares if "fan" in x.owner)
    assert weak.power == pytest.approx(-3e-30)


def test_energy_is_told_as_a_table_and_as_json(tmp_path):
    path = tmp_path / "rod.yaml"
    path.write_text(DRIVEN, encoding="utf-8")
    text = CliRunner().invoke(main, ["energy", str(path)]).stdout
    assert "force 'brake'        0       0.08    -4.5" in text
    data = json.loads(CliRunner().invoke(main, ["energy", str(path), "--format", "json"]).stdout)
    assert [x["owner"] for x in data["entries"]][1] == "drive 'motor'"
    assert data["sum"]["power"] == pytest.approx(sum(x["power"] for x in data["entries"]))
