"""What a refusal says to do: the fewest numbers that suffice, the right unit, the cause once, and what then works."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

import mbstab
from mbstab.cli import main
from mbstab.errors import Location, ModelFileError, Problem
from mbstab.model.library import starts_folder

CART = """\
mbstab: 1
bodies:
  cart: {type: planar, mass: 40, inertia: 6, points: {axle: [-0.5, 0], L: [0.4, 0.2], R: [0.4, -0.2]}}
  left: {type: planar, mass: 0.5, inertia: 0.001, points: {pin: [0.03, 0], wheel: [-0.02, 0]}}
  right: {type: planar, mass: 0.5, inertia: 0.001, points: {pin: [0.03, 0], wheel: [-0.02, 0]}}
joints:
  L: {type: revolute, between: [left.pin, cart.L]}
  R: {type: revolute, between: [right.pin, cart.R]}
contacts:
  axle: {type: knife_edge, at: cart.axle, along: x}
  wl: {type: knife_edge, at: left.wheel, along: x}
  wr: {type: knife_edge, at: right.wheel, along: x}
reference:
  coordinates: {cart: {x: 0, y: 0, theta: 0}, left: {theta: 0}, right: {theta: 0}}
  rates: {cart: {x: 1}}
"""
WHEELS = """\
mbstab: 1
parameters: {n: {value: 1500, unit: rpm}}
ground: {points: {G: [1, 0]}}
bodies:
  eng: {type: planar, mass: 10, inertia: 1, points: {p: [0.1, 0]}}
  gear: {type: planar, mass: 10, inertia: 3}
  pen: {type: planar, mass: 1, inertia: 0, points: {h: [-0.03, 0]}}
joints:
  eng: {type: revolute, between: [eng, ground]}
  gear: {type: revolute, between: [gear, ground.G]}
  mesh: {type: gear, joints: [eng, gear], teeth: [20, 50]}
  h: {type: revolute, between: [pen.h, eng.p]}
reference:
  coordinates: {eng: {theta: 0}, pen: {theta: 0}}
  steady: {axis: z, rate: n}
  rates: {eng: {theta: n}, pen: {theta: n}}
"""
POINT = "mbstab: 1\nbodies: {b: {type: planar_point, mass: 1}}\nconstraints: {y: {holonomic: b.y}}\n"
LIFTED = """\
mbstab: 1
parameters: {m: 1, T: 0.05, k: 4, d: 3}
gravity: [0, 0, -9.81]
bodies: {drone: {type: spatial, mass: m, inertia: [0.01, 0.01, 0.02]}}
states: {F: {rate: (m*9.81 - k*drone.z - d*rate(drone.z) - F)/T}}
forces: {thrust: THRUST}
reference: {coordinates: {drone: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}, F: 9.81}}
"""


def said(text, **values):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(text).at(**values).eig()
    return str(caught.value)


def test_the_fewest_rates_that_determine_the_others_are_named_and_suffice():
    message = said(CART)
    assert "the constraints do not determine all rates: cart.theta is missing" in message
    assert "hint: give cart.theta under reference.rates" in message
    found = mbstab.loads(CART.replace("cart: {x: 1}}", "cart: {x: 1, theta: 0}}")).eig()
    assert found.reference.u[0] == 1.0 if hasattr(found, "reference") else found.verdict


def test_each_motion_that_is_left_needs_one_rate():
    text = CART.replace("contacts:\n", "").replace("  axle: {type: knife_edge, at: cart.axle, along: x}\n", "")
    text = re.sub(r"  w[lr]: .*\n", "", text)
    (names,) = re.findall(r"do not determine all rates: (.*) are missing", said(text))
    assert sorted(names.split(", ")) == ["cart.theta", "cart.y", "left.theta", "right.theta"]


def test_a_wheel_off_the_axis_of_a_steady_motion_is_told_as_that():
    message = said(WHEELS)
    assert "it holds a body at (1, 0) m, which is not on the axis of the steady motion" in message
    assert "correct the rates" not in message
    periodic = WHEELS.replace("  steady: {axis: z, rate: n}\n", "  period: 2*pi/n\n")
    assert mbstab.loads(periodic).eig().period == pytest.approx(0.04)


@pytest.mark.parametrize(("value", "unit"), [("v/0.34", "0.34 is a plain number; if it stands for m,"),
                                            ("v*0.34", "0.34 is a plain number; if it stands for 1/m,"),
                                            ("-(v/(2*0.34))", "0.34 is a plain number; if it stands for m,"),
                                            ("v/(3/0.34)", "3 is a plain number; if it stands for m,")])  # fmt: skip
def test_a_number_that_lacks_a_unit_is_told_which(value, unit):
    text = (
        "mbstab: 1\nparameters: {v: {value: 5, unit: m/s}}\nbodies: {w: {type: planar, mass: 1, inertia: 1}}\n"
        f'reference: {{coordinates: {{w: {{x: 0, y: 0, theta: 0}}}}, rates: {{w: {{theta: "{value}"}}}}}}\n'
    )
    assert unit in said(text)


def test_a_kink_in_the_rate_of_a_state_is_shown_whole():
    text = POINT + (
        'states: {z: {rate: "rate(b.x) - abs(rate(b.x))*z"}}\nforces: {f: {type: expression, on: {b.x: "-z"}}}\n'
        "reference: {coordinates: {b: {x: 0}}}\n"
    )
    (reason,) = mbstab.loads(text).eig().reasons
    assert "states.z (abs(rate(b.x))) has no second derivative" in reason


def test_a_state_in_a_force_along_an_axis_of_a_body_is_shown_how():
    vector = "{type: force, at: drone, frame: body, vector: [0, 0, F]}"
    assert "{vz(body.point): F} takes them" in said(LIFTED.replace("THRUST", vector))
    along = mbstab.loads(LIFTED.replace("THRUST", "{type: expression, on: {vz(drone): F}}"))
    values = np.array([e.value for e in along.eig().eigenvalues if abs(e.value) > 1e-6])
    for s in np.roots([0.05, 1.0, 3.0, 4.0]):  # T s³ + s² + d s + k = 0
        assert np.min(np.abs(values - s)) < 1e-9


def test_what_to_do_about_several_problems_is_said_once():
    place = Location("a.yaml", 1, 1)
    error = ModelFileError([Problem(place, f"rows[{i}]", "wrong", "turn it") for i in range(37)])
    assert str(error).count("turn it") == 1
    assert str(error).count("wrong") == 37


@pytest.mark.parametrize("path", sorted(starts_folder().glob("*.yaml")), ids=lambda path: path.stem)
def test_what_a_new_file_names_exists_under_its_new_name(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(main, ["new", path.stem, "other name.yaml"]).exit_code == 0
    text = (tmp_path / "other name.yaml").read_text()
    for name in re.findall(r"(\w+)\.yaml", path.read_text()):
        if name != path.stem:
            assert f"{name}.yaml" in text
    for name in re.findall(r"mbstab models copy (\w+\.yaml)", text):
        assert CliRunner().invoke(main, ["models", "copy", name]).exit_code == 0


COASTING = """\
mbstab: 1
parameters: {v: 5, c: 0.2, k: 2}
bodies: {car: {type: planar, mass: 1, inertia: 1}}
constraints: {turn: {holonomic: car.theta}}
forces: {drag: {type: expression, on: {car.x: c*rate(car.x)*(v**2 - rate(car.x)**2), car.y: -k*car.y - rate(car.y)}}}
reference:
  find: steady
  steady: {direction: x}
  coordinates: {car: {x: 0}}
"""


@pytest.mark.parametrize("sense", [1, -1])
def test_guessed_rates_choose_the_direction_of_travel(sense):
    text = COASTING + f"  guess: {{car: {{y: 0.1}}, rates: {{car: {{x: {sense * 4}}}}}}}\n"
    (found,) = mbstab.loads(text).equilibria()
    assert found.motion.u[0] == pytest.approx(sense * 5.0)


def test_rates_are_guessed_of_a_steady_motion_only():
    text = COASTING.replace("  find: steady\n  steady: {direction: x}\n", "")
    assert "rates are guessed only of a steady motion" in said(text + "  guess: {rates: {car: {x: 4}}}\n")


def test_a_part_guesses_rates_of_its_own_bodies():
    part = COASTING.replace("mbstab: 1\n", "") + "  guess: {rates: {car: {x: -4}}}\n"
    main_text = "mbstab: 1\ninclude: [{file: part.yaml, prefix: a_}]\nreference: {guess: {rates: {b: {x: 1}}}}\n"
    main_text += "bodies: {b: {type: planar, mass: 1, inertia: 1}}\njoints: {j: {type: fixed, between: [b, a_car]}}\n"
    from mbstab.model.reader import read_model_text

    model = read_model_text(main_text, "m.yaml", {"part.yaml": part})
    assert {name: x.text for name, x in model.reference.guess_rates.items()} == {"b.x": "1", "a_car.x": "-4"}
