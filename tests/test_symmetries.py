"""Symmetries, conserved momenta and energies, reversors: found element by element, nonlinearly."""

import itertools
import json
from collections import Counter

import numpy as np
import pytest

import mbstab
from mbstab.analysis.linear.linearize import linearize
from mbstab.analysis.reference import symmetries
from mbstab.analysis.reference.fields import field_values
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.tolerances import TOLERANCES as REFERENCE
from mbstab.analysis.verdict.facts import Grounds
from mbstab.compiler.system import System
from mbstab.model.reader import read_model_text
from mbstab.model.values import evaluate


def grounds(text):
    system = System(evaluate(read_model_text(text, "model.yaml"), {}))
    return Grounds(linearize(system, reference_motion(system)))


def plane(laws, more="", reference="coordinates: {p: {x: 0, y: 0}}"):
    return grounds(
        "mbstab: 1\nbodies: {p: {type: planar_point, mass: 1}}\n"
        f"forces: {{push: {{type: expression, on: {laws}}}}}\n{more}reference: {{{reference}}}\n"
    )


def names(found):
    return {item.name for item in found}


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        ("-rate(p.y)", {"p.x", "p.y"}),
        ("-rate(p.y) + p.y**3", {"p.x"}),
        ("-1e6*rate(p.y) + 1e-9*p.y**3", {"p.x"}),  # weak beside strong
        ("-rate(p.y) - tanh(1e4*p.y)", {"p.x"}),  # flat wherever it is not near
        ("-rate(p.y) + 0.1*smooth_start((p.y - 3)/10)", {"p.x"}),  # flat at the reference
        ("-rate(p.y) + exp(-(p.y - 9)**2) - exp(-81)", {"p.x"}),
    ],
)
def test_a_shift_is_a_symmetry_only_if_it_holds_everywhere(law, expected):
    assert names(plane(f"{{p.x: -rate(p.x), p.y: '{law}'}}").invariance.symmetries) == expected


def test_a_turn_is_found_about_the_point_to_which_a_body_is_fixed():
    found = grounds(
        "mbstab: 1\ngravity: [0, 0, -9.81]\n"
        "bodies: {rod: {type: spatial, mass: 1, shape: {type: rod, length: 1}, points: {O: [0, 0, 0.5]}}}\n"
        "joints: {pivot: {type: spherical, between: [rod.O, {body: ground, point: [3, -2, 1]}]}}\n"
        "reference: {coordinates: {rod: {x: 3, y: -2, z: 0.5, phi: 0, theta: 0, psi: 0}}}\n"
    )
    assert any("through (3, -2, 0)" in name for name, _ in found.invariance.fields)


def test_a_ball_may_turn_about_any_of_its_axes():
    found = grounds(
        "mbstab: 1\nbodies: {ball: {type: spatial, mass: 1, shape: {type: sphere, radius: 1}}}\n"
        "reference: {coordinates: {ball: {x: 0, y: 0, z: 0, phi: 0.2, theta: 0.3, psi: 0.1}}, "
        "rates: {ball: {phi: 1, theta: 0.5, psi: -0.4}}}\n"
    )
    assert found.separated.neutral.count == 12
    assert found.separated.A.size == 0


def test_fields_and_their_derivatives_are_those_of_differences():
    found = grounds(
        "mbstab: 1\nbodies:\n  a: {type: spatial, mass: 1, shape: {type: sphere, radius: 1}}\n"
        "reference: {coordinates: {a: {x: 1, y: 2, z: 3, phi: 0.2, theta: 0.3, psi: 0.1}}, "
        "rates: {a: {x: 0.1, phi: 0.2, theta: -0.3, psi: 0.4}}}\n"
    )
    q, h = found.motion.q, 1e-5
    for _, field in found.invariance.fields:
        slope = np.array([(field.field(q + h * e) - field.field(q - h * e)) / (2 * h) for e in np.eye(len(q))]).T
        assert field.slope(q) == pytest.approx(slope, abs=1e-8)
    for block in found.invariance.identities.basis.blocks:
        own, u, a = (x[block.part] for x in (q, found.motion.u, np.linspace(0.3, -0.2, len(q))))
        there = [field_values(block, own + t * u + 0.5 * t * t * a).X for t in (-h, 0.0, h)]
        values = field_values(block, own, u, a)
        assert values.rate == pytest.approx((there[2] - there[0]) / (2 * h), abs=1e-8)
        assert values.growth == pytest.approx((there[2] - 2 * there[1] + there[0]) / h**2, abs=1e-4)


@pytest.mark.parametrize(
    ("laws", "kind"),
    [
        ("{p.x: -p.x + p.y, p.y: p.x}", "potential"),
        ("{p.x: -p.x + p.y, p.y: -p.y}", "other"),
        ("{p.x: 3*rate(p.y), p.y: -3*rate(p.x)}", "powerless"),
        ("{p.x: p.y*rate(p.y), p.y: -p.y*rate(p.x)}", "powerless"),
        ("{p.x: -2*rate(p.x) - p.x**3, p.y: -rate(p.y)}", "damping"),
        ("{p.x: 2*rate(p.x)}", "other"),
        ("{p.x: -rate(p.x)**3}", "drag"),
        ("{p.x: -p.x*(1 + 1e-25*rate(p.x))}", "other"),
    ],
)
def test_what_forces_do_to_the_energy_is_told_from_their_expressions(laws, kind):
    work = plane(laws).structure.work
    assert [k for k, elements in work.kinds.items() if elements] == [kind]


def test_an_external_damper_on_a_driven_rotor_may_feed_energy_and_an_internal_one_may_not():
    text = (
        "mbstab: 1\nbodies: {{rotor: {{type: planar, mass: 1, inertia: 1}}, m: {{type: planar_point, mass: 1}}}}\n"
        "joints: {{axle: {{type: revolute, between: [rotor, ground]}}}}\n"
        "drives: {{spin: {{type: joint, joint: axle, position: 2*t}}}}\n"
        "forces: {{a: {{type: spring, between: [m, rotor], stiffness: 9}}, d: {damper}}}\n"
        "reference: {{steady: {{axis: z, rate: 2}}, coordinates: {{m: {{x: 0, y: 0}}, rotor: {{theta: 0}}}}}}\n"
    )
    inside = "{type: spring, between: [m, {body: rotor, point: [1, 0]}], length: 1, damping: 0.1}"
    outside = "{type: expression, on: {m.x: -0.1*rate(m.x), m.y: -0.1*rate(m.y)}}"
    assert grounds(text.format(damper=inside)).structure.work.decreases
    assert not grounds(text.format(damper=outside)).structure.work.decreases


def test_momenta_and_energy_have_differentials_that_the_equations_keep():
    for model in ("flyball_governor.yaml", "free_rigid_body.yaml", "chaplygin_sleigh.yaml", "whipple_bicycle.yaml"):
        model = mbstab.load(model).model
        system = System(evaluate(model, {}))
        found = Grounds(linearize(system, reference_motion(system))).separated
        size = np.linalg.norm(found.S, 2)
        assert np.linalg.norm(found.L @ found.S, 2) <= 1e-12 * size or not len(found.L)
        assert np.linalg.norm(found.S @ found.T - found.T @ (found.T.T @ found.S @ found.T), 2) <= 1e-12 * size


def test_a_wheel_that_rolls_straight_ahead_is_its_own_image_backwards_in_time():
    text = mbstab.load("rolling_torus.yaml").model
    system = System(evaluate(text, {}))
    found = Grounds(linearize(system, reference_motion(system)))
    assert (found.reversor.kept, found.reversor.reversed_) == (3, 1)
    assert len(found.separated.neutral.family) == 2


def test_states_are_written_once_for_all_elements(monkeypatch):
    count, written, own = 8, [], symmetries.with_errors
    monkeypatch.setattr(symmetries, "with_errors", lambda *states: written.append(states) or own(*states))
    names = [f"b{i}" for i in range(count)]
    scene = {
        "mbstab": 1,
        "bodies": {name: {"type": "planar", "mass": 1, "inertia": 1} for name in names},
        "forces": {
            f"s{name}": {"type": "bearing", "between": [name, other], "stiffness": 100, "damping": 1}
            for name, other in itertools.pairwise([*names, "ground"])
        },
        "reference": {"coordinates": {name: {"x": 0, "y": 0, "theta": 0} for name in names}},
    }
    result = mbstab.loads(json.dumps(scene)).eig()
    assert result.counts.neutral == 2 * count
    # At rest and in motion, at each speed, along each of the turns and two combinations.
    assert 0 < len(written) <= 2 * len(REFERENCE.trial_speeds) * (count + 2)


def test_the_equations_are_evaluated_once_at_the_states_that_are_compared(monkeypatch):
    points, dynamics = Counter(), System.dynamics

    def counted(self, q, u, time=None):
        if len(self.acting()) > 1 and np.asarray(q).dtype == float:
            points[np.concatenate([q, u]).tobytes()] += 1
        return dynamics(self, q, u, time)

    monkeypatch.setattr(System, "dynamics", counted)
    mbstab.load("whipple_bicycle.yaml").eig()
    # The reference at rest: assembled, asked whether its loops close, and whether the rows allow rest.
    assert max(points.values()) <= 3
    assert len(points) > 30


def test_a_common_shift_names_what_moves_in_each_unit():
    """A rack travels 0.05 m per radian of its pinion: as numbers, little; but metres are no radians."""
    text = """mbstab: 1
parameters: {r: {value: 0.05, unit: m}}
bodies:
  pinion: {type: planar, mass: 1, inertia: 0.01}
  rack: {type: planar, mass: 1, inertia: 0.01}
joints:
  axle: {type: revolute, between: [pinion, ground]}
  rail: {type: prismatic, between: [rack, ground], axis: x}
  mesh: {type: rack, joints: [rail, axle], radius: r}
"""
    (found,) = mbstab.loads(text).eig().modulo.symmetries
    assert found == "common shift of pinion.theta, rack.x"
