"""Symmetries as identities: whatever form a law is written in, the answer is the same; nothing is called symmetric that
is not."""

import numpy as np
import pytest

import mbstab
from mbstab.analysis.reference.requested import reference_motion
from mbstab.analysis.reference.symmetries import Invariance
from mbstab.analysis.verdict.rule import ASYMPTOTIC_UP_TO, STABLE_UP_TO, UNDECIDED, UNSTABLE
from mbstab.analysis.verdict.work import Work
from mbstab.compiler.system import System
from mbstab.model.reader import read_model_text
from mbstab.model.values import evaluate

HINGED = """
mbstab: 1
bodies:
  a: {{type: spatial, mass: 1, inertia: [1, 1, 2]}}
  b: {{type: spatial, mass: 1, inertia: [1, 1.5, 1.2]}}
joints: {{j: {{type: revolute, between: [a, b], axis: x}}}}
{law}
reference:
  coordinates: {{a: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}, b: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}}
"""

LAWS = {
    "joint spring": "forces: {s: {type: joint_spring, joint: j, stiffness: 2, damping: 1}}",
    "expression": 'forces: {s: {type: expression, on: {angle(j): "-2*angle(j) - rate(angle(j))"}}}',
    "pid": "forces: {s: {type: pid, joint: j, of: angle(j), P: 2, D: 1}}",
}

SHIFTED = """
mbstab: 1
bodies: {{a: {{type: planar_point, mass: 1}}, b: {{type: planar_point, mass: 1}}}}
forces: {{grav: {{{law}}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}, b: {{x: 1, y: 0}}}}}}
"""


@pytest.mark.parametrize("name", LAWS)
def test_a_law_of_a_hinge_between_free_bodies_gives_one_answer(name):
    """Bodies with small momenta tumble for ever (Euler): they stay near rest, and do not come to a steady motion."""
    answer = mbstab.loads(HINGED.format(law=LAWS[name])).eig()
    assert answer.verdict == STABLE_UP_TO
    assert answer.counts.neutral == 12
    assert (answer.spectrum.right, answer.spectrum.left, answer.spectrum.open) == (0, 2, 0)


def test_a_ball_may_turn_about_any_axis_and_other_bodies_tumble():
    ball = "mbstab: 1\nbodies: {a: {type: spatial, mass: 1, inertia: [%s]}}\nstates: {s: {rate: -s}}\n"
    rest = "reference: {coordinates: {a: {x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}, s: 0}}\n"
    assert mbstab.loads(ball % "2, 2, 2" + rest).eig().verdict == ASYMPTOTIC_UP_TO
    assert mbstab.loads(ball % "2, 3, 4" + rest).eig().verdict == STABLE_UP_TO


@pytest.mark.parametrize(
    "law",
    [
        "type: spring, between: [a, b], stiffness: 1, length: 1",
        'type: expression, on: {"distance(a, b)": "1 - distance(a, b)"}',
        'type: expression, on: {a.x: "(1 - 1/hypot(b.x-a.x, b.y-a.y))*(b.x-a.x)", '
        'a.y: "(1 - 1/hypot(b.x-a.x, b.y-a.y))*(b.y-a.y)", b.x: "-(1 - 1/hypot(b.x-a.x, b.y-a.y))*(b.x-a.x)", '
        'b.y: "-(1 - 1/hypot(b.x-a.x, b.y-a.y))*(b.y-a.y)"}',
    ],
)
def test_two_masses_with_a_law_of_their_distance(law):
    answer = mbstab.loads(SHIFTED.format(law=law)).eig()
    assert (answer.verdict, answer.counts.neutral) == (STABLE_UP_TO, 6)
    assert {"translation along x", "translation along y", "rotation in the plane"} <= set(answer.modulo.symmetries)


def test_masses_that_circle_each_other():
    """Newton's two bodies, radial λ = ± iω: {0, 0, ± √2 i three times}."""
    orbit = mbstab.loads("""
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
forces:
  grav: {type: expression, on: {"distance(a, b)": "-1/distance(a, b)**2"}}
reference:
  coordinates: {a: {x: -0.5, y: 0}, b: {x: 0.5, y: 0}}
  rates: {a: {x: 0, y: -sqrt(2)/2}, b: {x: 0, y: sqrt(2)/2}}
  steady: {axis: z}
""").eig()
    assert orbit.verdict == STABLE_UP_TO
    values = np.sort_complex(np.array([e.value for e in orbit.eigenvalues]))
    assert np.abs(values.real).max() < 1e-7
    assert np.sort(values.imag) == pytest.approx(np.sqrt(2.0) * np.array([-1, -1, -1, 0, 0, 1, 1, 1]), abs=1e-7)


@pytest.mark.parametrize("w", [20, 44, 88, 100, 120])
def test_a_gyrocompass_is_steady_at_any_spin(w):
    """Small coefficients are differences of large ones; ω = √((C w Ω − A Ω²)/(A + J)) with all inertias."""
    text = f"""
mbstab: 1
parameters: {{Om: {{value: 0.1, unit: rad/s}}, w: {{value: {w}, unit: rad/s}}}}
bodies:
  earth: {{type: spatial, mass: 1, inertia: [1, 1, 1]}}
  frame: {{type: spatial, mass: 1, inertia: [0.01, 0.01, 0.01]}}
  rotor: {{type: spatial, mass: 1, inertia: [0.06, 0.06, 0.1]}}
joints:
  axis: {{type: revolute, between: [earth, ground], axis: z}}
  azimuth: {{type: revolute, between: [frame, earth], axis: x}}
  spin: {{type: revolute, between: [rotor, frame], axis: z}}
drives: {{turn: {{type: joint, joint: axis, position: Om*t}}}}
reference:
  steady: {{axis: z, rate: Om}}
  coordinates:
    earth: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
    frame: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
    rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}
  rates:
    earth: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: Om}}
    frame: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: Om}}
    rotor: {{x: 0, y: 0, z: 0, phi: 0, theta: 0, psi: w}}
"""
    found = mbstab.loads(text).eig()
    C, A, J, Om = 0.1, 0.06, 0.01, 0.1
    frequency = max(e.value.imag for e in found.eigenvalues)
    assert frequency == pytest.approx(np.sqrt((C * w * Om - A * Om**2) / (A + J)), rel=1e-9)


# Flat to all digits but near the reference.
@pytest.mark.parametrize(
    ("scene", "allowed"),
    [
        (
            "gravity: [0, -9.81]\nbodies: {a: {type: planar_point, mass: 1}}\n"
            'constraints: {rail: {holonomic: "a.y - 0.01*exp(-((a.x - 5)/0.2)**4)"}}\n'
            'forces: {f: {type: expression, on: {a.x: "-rate(a.x)"}}}\n'
            "reference: {coordinates: {a: {x: 5, y: 0.01}}}\n",
            {UNSTABLE},  # the top of a hump
        ),
        (
            "bodies: {a: {type: planar_point, mass: 1}}\n"
            'forces: {f: {type: expression, on: {a.x: "-a.x - rate(a.x)", a.y: "-a.y - rate(a.y)"}}}\n'
            'states: {s: {rate: "s**3*exp(-1e4*s**2)"}}\n'
            "reference: {coordinates: {a: {x: 0, y: 0}}}\n",
            {UNDECIDED, UNSTABLE},  # s' > 0 for s > 0
        ),
        (
            "bodies: {a: {type: planar_point, mass: 1}}\n"
            'forces: {f: {type: expression, on: {a.x: "-a.x - rate(a.x)"}}}\n'
            'constraints: {n: {nonholonomic: "rate(a.y) - a.y**3*exp(-1e4*a.y**2)"}}\n'
            "reference: {coordinates: {a: {x: 0, y: 0}}}\n",
            {UNDECIDED, UNSTABLE},
        ),
    ],
)
def test_what_is_flat_far_away_is_no_symmetry(scene, allowed):
    mechanism = mbstab.loads("mbstab: 1\n" + scene)
    assert mechanism.eig().verdict in allowed
    assert mechanism.eig_precise(30).verdict in allowed


def test_a_shift_that_is_one_to_rounding_only_is_none():
    """Two masses on springs with the ratio √2 of their gear, off by 1e-15: the truth is a small real eigenvalue."""
    text = """
mbstab: 1
parameters: {{r: 1.25, e: {e}}}
bodies: {{a: {{type: planar_point, mass: 1}}, b: {{type: planar_point, mass: 1}}}}
constraints: {{ay: {{holonomic: a.y}}, by: {{holonomic: b.y}}}}
forces:
  s: {{type: expression, on: {{a.x: "-(a.x - r*b.x) + e*a.x - rate(a.x)", b.x: "r*(a.x - r*b.x) - rate(b.x)"}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}, b: {{x: 0, y: 0}}}}}}
"""
    assert mbstab.loads(text.format(e="0")).eig().verdict == ASYMPTOTIC_UP_TO
    for e in ("1e-15", "1e-25"):
        assert mbstab.loads(text.format(e=e)).eig().verdict in (UNDECIDED, UNSTABLE)


def test_a_drive_that_passes_an_axis_at_the_reference_time_leaves_no_rotation():
    trailer = mbstab.load("trailer.yaml").eig()
    assert trailer.counts.neutral == 0


def test_undamped_torsion_of_a_rotor_decouples_from_its_bending():
    """ω² = k (1/J₁ + 1/J₂) = 1000 (1/0.1 + 1/0.2) turns beside eight eigenvalues that decay."""
    rotor = mbstab.loads("""
mbstab: 1
parameters: {n: {value: 100, unit: rad/s}, k: 1000, across: 1e5}
bodies:
  hub: {type: planar, mass: 1, inertia: 0.1}
  disk: {type: planar, mass: 10, inertia: 0.2}
forces:
  shaft:
    {type: bushing, between: [disk, hub], stiffness: [1e5, across], damping: [10, 10], torsional_stiffness: k}
  mount: {type: bushing, between: [hub, ground], stiffness: [1e6, 1e6], damping: [500, 500]}
reference:
  coordinates: {hub: {x: 0, y: 0, theta: 0}, disk: {x: 0, y: 0, theta: 0}}
  rates: {hub: {theta: n}, disk: {theta: n}}
""")
    answer = rotor.eig()
    assert answer.verdict == STABLE_UP_TO
    assert (answer.spectrum.right, answer.spectrum.left, answer.spectrum.not_right) == (0, 8, 2)
    slowest = min((e.value for e in answer.eigenvalues if e.kind != "neutral"), key=lambda s: abs(s.real))
    assert abs(slowest.imag) == pytest.approx(np.sqrt(1000 * (1 / 0.1 + 1 / 0.2)), rel=1e-9)


def test_straight_runs_under_another_heading_are_a_family_of_a_driven_car():
    car = mbstab.loads("""
mbstab: 1
parameters: {u: 20}
bodies: {car: {type: planar, mass: 1700, inertia: 3500, points: {f: [1.2, 0], r: [-1.7, 0]}}}
drives: {speed: {type: coordinate, coordinate: car.x, position: u*t}}
forces:
  f: {type: tyre, at: car.f, cornering_stiffness: 80000}
  r: {type: tyre, at: car.r, cornering_stiffness: 80000}
reference: {coordinates: {car: {x: 0, y: 0, theta: 0}}, rates: {car: {x: u}}}
""").eig()
    assert (car.verdict, car.counts.neutral) == (ASYMPTOTIC_UP_TO, 2)
    assert car.spectrum.chains is None or car.spectrum.chains.zeros == (2,)
    (value,) = [e.value for e in car.eigenvalues if e.value.imag > 0.0]
    assert value == pytest.approx(-4.827 + 3.277j, abs=1e-3)


def test_what_drifts_along_a_family_that_is_no_symmetry_is_not_stable():
    """a drifts past 90 degrees, and the spring of b then pushes: b grows, although all neighbours are steady."""
    assert mbstab.loads("""
mbstab: 1
bodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}
constraints: {ay: {holonomic: a.y}, by: {holonomic: b.y}}
forces: {s: {type: expression, on: {b.x: "-cos(a.x)*b.x - rate(b.x)"}}}
reference: {coordinates: {a: {x: 0, y: 0}, b: {x: 0, y: 0}}}
""").eig().verdict in (UNDECIDED, UNSTABLE)


@pytest.mark.parametrize("omega", [3.0, 5.2])
def test_random_states_at_which_rows_become_dependent_are_left_out(omega):
    """The governor turns steadily at any rate; a random state may close onto a singular position of its arms."""
    found = mbstab.load("governor.yaml").eig(omega=omega)
    assert (found.verdict, found.counts.neutral) == (ASYMPTOTIC_UP_TO, 1)


@pytest.mark.parametrize(
    ("rate", "linear"),
    [("0.1*rate(a.x) + rate(b.x)", True), ("0.1*sqrt(rate(a.x)**2 + rate(b.x)**2)", False)],
)
def test_a_row_that_doubles_with_the_speeds_need_not_be_linear_in_them(rate, linear):
    model = read_model_text(
        "mbstab: 1\nbodies: {a: {type: planar_point, mass: 1}, b: {type: planar_point, mass: 1}}\n"
        f"constraints: {{row: {{nonholonomic: rate(a.y) - ({rate})}}}}\n"
        "reference: {coordinates: {a: {x: 0}, b: {x: 0, y: 0}}, rates: {a: {x: 3}, b: {x: 4, y: 0}}}\n",
        "row.yaml",
    )
    system = System(evaluate(model))
    invariance = Invariance(system, reference_motion(system))
    assert Work(invariance, None).rows_at_rest == linear
