"""Named expressions that all others of a file may use."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

import mbstab
from mbstab.cli.main import main
from mbstab.errors import ModelFileError

LINK = """\
mbstab: 1
gravity: [0, -9.81]
parameters: {{T: 0.05, P: 50, D: 10, l: 0.5}}
{definitions}
bodies: {{rod: {{type: planar, mass: 1, inertia: {inertia}, points: {{O: [-l, 0]}}}}}}
joints: {{pin: {{type: revolute, between: [rod.O, ground]}}}}
states: {{M: {{rate: {rate}}}}}
forces: {{motor: {{type: expression, on: {{angle(pin): {torque}}}}}}}
reference: {{find: equilibrium, guess: {{rod: {{x: 0.5, theta: 0}}}}}}
{rest}
"""
NAMED = {
    "definitions": """\
definitions:
  asked: -P*error - D*speed   # further down is as good
  error: angle(pin)
  speed: rate(angle(pin))
  own: 0.4*l**2
  lag: (asked - M)/T""",
    "inertia": "own",
    "rate": "lag",
    "torque": "M + error*own*0",
    "rest": "outputs: {what: -P*error, how: 2*own}\ninputs: {push: {type: joint, joint: pin}}",
}
WRITTEN = {
    "definitions": "",
    "inertia": "0.4*l**2",
    "rate": "(-P*angle(pin) - D*rate(angle(pin)) - M)/T",
    "torque": "M",
    "rest": "outputs: {what: -P*angle(pin), how: 2*0.4*l**2}\ninputs: {push: {type: joint, joint: pin}}",
}


def test_a_model_with_definitions_is_the_one_with_what_they_stand_for():
    named, written = (mbstab.loads(LINK.format(**x)) for x in (NAMED, WRITTEN))
    assert named.motion().q.tolist() == written.motion().q.tolist()
    assert named.eig().values().tolist() == written.eig().values().tolist()
    assert named.eig_precise(20).values() == written.eig_precise(20).values()
    axis = np.array([0.03, 0.05, 0.08])
    assert named.sweep("T", axis).branches.tolist() == written.sweep("T", axis).branches.tolist()
    runs = [x.simulate(to=0.1, points=3, perturb={"rod.theta": 0.1}).q[-1].tolist() for x in (named, written)]
    assert runs[0] == runs[1]
    answers = []
    for text in (NAMED, WRITTEN):
        arguments = ["linearize", "-", "--format", "json"]
        answers.append(json.loads(CliRunner().invoke(main, arguments, input=LINK.format(**text)).output))
    assert answers[0]["state-space"] == answers[1]["state-space"]


def test_the_closed_form_of_a_definition_in_a_definition():
    found = mbstab.loads(LINK.format(**NAMED))
    theta = found.motion().q[2]
    stiffness = -9.81 * 0.5 * np.sin(theta)
    expected = np.roots(np.polyadd(np.polymul([0.35, 0.0, stiffness], [0.05, 1.0]), [10.0, 50.0]))
    assert np.sort_complex(found.eig().values()) == pytest.approx(np.sort_complex(expected), rel=1e-12)


def test_a_definition_of_time_drives():
    mechanism = mbstab.loads(
        "mbstab: 1\ndefinitions: {go: 0.1*sin(3*t)}\nbodies: {b: {type: planar_point, mass: 1}}\n"
        "constraints: {line: {holonomic: b.y}}\nforces: {all: {type: expression, on: {b.x: go - 2*b.x}}}\n"
        "reference: {period: 2*pi/3, coordinates: {b: {x: 0, y: 0}}, rates: {b: {x: 0.0}}}"
    )
    run = mechanism.simulate(to=1.0, points=2)

    def slope(t, y):
        return [y[1], 0.1 * np.sin(3.0 * t) - 2.0 * y[0]]

    end = solve_ivp(slope, (0.0, 1.0), [0.0, 0.0], rtol=1e-11, atol=1e-13).y[:, -1]
    assert run.q[-1][0] == pytest.approx(end[0], abs=1e-8)


@pytest.mark.parametrize(
    ("definitions", "line", "message"),
    [
        ("a: b + 1\n  b: 2*c\n  c: a", "5:6", "definitions depend on each other in a circle: a → b → c → a"),
        ("a: 1 + a", "5:10", "definitions depend on each other in a circle: a → a"),
        ("l: 3", "5:3", "the name 'l' is taken"),
        ("t: 3", "5:3", "the name 't' is taken"),
        ("sin: 3", "5:3", "the name 'sin' is taken"),
        ("a: {value: 3}", "5:6", "expected an expression"),
        ("a: 3 +", "5:9", "expected a number"),
        ("a: 2*rod.z", "5:8", "unknown coordinate 'rod.z'"),
        ("a: 2*N", "5:8", "unknown parameter 'N'"),
        ("a: angle(pivot)", "5:6", "there is no joint 'pivot'"),
        ("a: angle(pin)\n  b: rate(a)", "6:6", "'a' is a definition"),
        ("M: 3", "8:10", "the name 'M' is taken"),
        ("a: rate(rod.x)\n  b: sign(3, a)", "6:14", "the width of sign() must be constant"),
        ("a: 1 + 1/(T - T)*asked\n  asked: t", "", ""),
    ],
)
def test_bad_definitions_are_refused_where_they_stand(definitions, line, message):
    text = LINK.format(**{**WRITTEN, "definitions": f"definitions:\n  {definitions}"})
    if not message:
        mbstab.loads(text)
        return
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(text)
    assert re.search(f"<text>:{line}: [a-zA-Z.]+: {re.escape(message)}", str(caught.value)), str(caught.value)
    assert str(caught.value).count("<text>") == 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"inertia": "2*error"}, "measures such as 'angle(pin)' cannot be used here"),
        ({"rest": "expect: [{at: {T: own}}]"}, "definitions such as 'own' cannot be used here"),
        ({"rest": "sweep: {T: {from: own, to: 2}}"}, "definitions such as 'own' cannot be used here"),
        ({"torque": "errol"}, "unknown parameter 'errol'"),
    ],
)
def test_a_definition_stands_where_what_it_stands_for_may(changed, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(LINK.format(**{**NAMED, **changed}))
    assert message in str(caught.value)


def test_definitions_do_not_grow_without_bounds():
    lines = [f"  a{i}: a{i + 1} + a{i + 1}" for i in range(40)]
    text = "mbstab: 1\ndefinitions:\n" + "\n".join(lines) + "\n  a40: 1\nbodies: {b: {type: planar_point, mass: a0}}"
    with pytest.raises(ModelFileError, match="the expression is too long with all its definitions"):
        mbstab.loads(text)


def test_a_kink_in_a_definition_is_told_by_its_name():
    text = (
        "mbstab: 1\ndefinitions: {slip: b.x, rub: smooth_start(slip)}\nbodies: {b: {type: planar_point, mass: 1}}\n"
        "constraints: {line: {holonomic: b.y}}\nforces: {all: {type: expression, on: {b.x: -b.x**3 - 2*rub}}}"
    )
    (reason,) = mbstab.loads(text).eig().judged.reasons
    assert "forces.all (rub) has no second derivative where its argument is 0" in reason
