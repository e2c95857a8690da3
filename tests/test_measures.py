"""Measures in expressions: against built-in elements, and vehicles and controllers against closed forms."""

import numpy as np
import pytest

import mbstab
from mbstab.cli.commands.schema import section_text
from mbstab.errors import ModelFileError
from mbstab.mechanics.measures import MEASURES
from mbstab.model.expressions import ExpressionError, parse
from mbstab.model.measures import unit_of_output

BODIES = {
    2: """\
bodies:
  a: {type: planar, mass: 2, inertia: 0.3, points: {p: [0.2, -0.1]}}
  b: {type: planar, mass: 1, inertia: 0.2, points: {p: [-0.3, 0.4]}}
joints: {turn: {type: revolute, between: [a.p, b.p]}, slide: {type: prismatic, between: [b, ground], axis: x}}
""",
    3: """\
bodies:
  a: {type: spatial, mass: 2, inertia: [0.3, 0.4, 0.5], axes: [0.3, -0.4, 0.8], points: {p: [0.2, -0.1, 0.3]}}
  b: {type: spatial, mass: 1, inertia: [0.2, 0.3, 0.25], points: {p: [-0.3, 0.4, 0.1]}}
joints:
  turn: {type: revolute, between: [a.p, b.p], axis: [[1, 2, 2], [2, 1, 2]], zero: [[2, -1, 0], [1, -2, 0]]}
  slide: {type: prismatic, between: [b, ground], axis: [[1, 2, 2], [2, 2, 1]], zero: [[2, -1, 0], [0, 1, -2]]}
""",
}

SAME = [
    (
        "{type: joint_spring, joint: turn, stiffness: 7, damping: 0.6, rest: 0.1}",
        "{angle(turn): -7*(angle(turn) - 0.1) - 0.6*rate(angle(turn))}",
    ),
    (
        "{type: joint_spring, joint: slide, stiffness: 7, damping: 0.6, rest: 0.1}",
        "{displacement(slide): -7*(displacement(slide) - 0.1) - 0.6*rate(displacement(slide))}",
    ),
    ("{type: actuator, joint: turn, effort: 3*t}", "{angle(turn): 3*t}"),
    (
        "{type: spring, between: [a.p, b], stiffness: 5, length: 0.4, damping: 0.3}",
        "{'distance(a.p, b)': '-5*(distance(a.p, b) - 0.4) - 0.3*rate(distance(a.p, b))'}",
    ),
    (
        "{type: spring, between: [a.p, ground], stiffness: 5, length: 0.4}",
        "{'distance(a.p, ground)': '-5*(distance(a.p, ground) - 0.4)'}",
    ),
]
PLANE = [
    ("{type: force, at: a.p, vector: [2, -3]}", "{x(a.p): 2, y(a.p): -3}"),
    ("{type: force, at: a.p, vector: [2, -3], frame: body}", "{vx(a.p): 2, vy(a.p): -3}"),
]
SPACE = [
    ("{type: force, at: a.p, vector: [2, -3, 4]}", "{x(a.p): 2, y(a.p): -3, z(a.p): 4}"),
    ("{type: force, at: a.p, vector: [2, -3, 4], frame: body}", "{vx(a.p): 2, vy(a.p): -3, vz(a.p): 4}"),
    ("{type: torque, body: a, vector: [2, -3, 4], frame: body}", "{wx(a): 2, wy(a): -3, wz(a): 4}"),
]


def force_alone(dimension, force):
    """Return the equations in which one force acts."""
    system = mbstab.loads(f"mbstab: 1\n{BODIES[dimension]}forces: {{f: {force}}}\n").system()
    return dict(system.parts())["forces.f"]


@pytest.mark.parametrize(
    ("dimension", "element", "written"),
    [(d, *pair) for d, pairs in ((2, [*SAME, *PLANE]), (3, [*SAME, *SPACE])) for pair in pairs],
)
def test_a_force_along_a_measure_is_the_built_in_force(dimension, element, written):
    one, other = force_alone(dimension, element), force_alone(dimension, f"{{type: expression, on: {written}}}")
    rng = np.random.default_rng(5)
    for _ in range(3):
        q, u = rng.uniform(-0.6, 0.6, (2, one.n_q))
        a, nu = rng.uniform(-1.0, 1.0, one.n_q), np.zeros(one.n_c)
        # Both angles within half a turn of the same place.
        np.testing.assert_allclose(other.dynamics(q, u, 0.7).F0, one.dynamics(q, u, 0.7).F0, rtol=1e-12, atol=1e-12)
        for x, y in zip(other.linearize(q, u, a, nu, 0.7), one.linearize(q, u, a, nu, 0.7), strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("dimension", [2, 3])
def test_constraints_on_measures_are_those_of_drives(dimension):
    """A given travel as an expression is the row of the drive, with all its derivatives."""
    drive = "drives: {d: {type: joint, joint: slide, position: 0.3*t**2}}\n"
    text = "constraints: {d: {holonomic: displacement(slide) - 0.3*t**2}}\n"
    one, other = (mbstab.loads(f"mbstab: 1\n{BODIES[dimension]}{x}").system() for x in (drive, text))
    rng = np.random.default_rng(6)
    q, u, a = rng.uniform(-0.6, 0.6, (3, one.n_q))
    nu = rng.uniform(-1.0, 1.0, one.n_c)
    for x, y in ((one.dynamics(q, u, 0.7), other.dynamics(q, u, 0.7)),):
        for name in ("E", "V", "J", "B"):
            np.testing.assert_allclose(getattr(x, name), getattr(y, name), rtol=1e-12, atol=1e-12)
    for x, y in zip(one.linearize(q, u, a, nu, 0.7), other.linearize(q, u, a, nu, 0.7), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-11)
    for x, y in zip(one.linearize_rows(q, u, a, 0.7), other.linearize_rows(q, u, a, 0.7), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-11, atol=1e-11)


CAR = """\
mbstab: 1
parameters: {{u: 10, a: 1.189, b: 1.696, C: 80000, m: 16975/9.81, sigma: 0.5}}
bodies:
  car: {{type: planar, mass: m, inertia: 3508, points: {{front: [a, 0], rear: [-b, 0]}}}}
{states}
forces:
  front: {{type: expression, on: {{vy(car.front): {front}}}}}
  rear: {{type: expression, on: {{vy(car.rear): {rear}}}}}
reference:
  coordinates: {{car: {{x: 0, y: 0, theta: 0}}}}
  rates: {{car: {{x: u, y: 0, theta: 0}}}}
"""
STIFF = {
    "states": "",
    "front": "-C*atan(vy(car.front)/vx(car.front))",
    "rear": "-C*atan(vy(car.rear)/vx(car.rear))",
}
RELAXED = {
    "states": """\
states:
  Yf: {rate: (-C*atan(vy(car.front)/vx(car.front)) - Yf)*vx(car.front)/sigma}
  Yr: {rate: (-C*atan(vy(car.rear)/vx(car.rear)) - Yr)*vx(car.rear)/sigma}""",
    "front": "Yf",
    "rear": "Yr",
}


def moving(found):
    """Return the eigenvalues that are not neutral, those above the real axis and on it."""
    return sorted((s for s in found.values() if s.imag >= 0.0), key=lambda s: (s.real, s.imag))


@pytest.mark.parametrize(
    ("u", "expected"),
    [
        (10, [-9.515101897115451 + 2.963081825535182j]),
        (20, [-4.757550948557725 + 3.296448275024203j]),
        (30, [-3.171700632371817 + 3.354549204317407j]),
    ],
)
def test_a_car_on_tyres(u, expected):
    """Two tyres with cornering stiffness on a yaw plane; place, heading and speed are neutral."""
    found = mbstab.loads(CAR.format(**STIFF)).eig(u=u)
    np.testing.assert_allclose(moving(found), expected, rtol=1e-12)
    assert found.counts.neutral == 4
    assert found.verdict == "asymptotically stable up to symmetry"


@pytest.mark.parametrize(
    ("u", "expected"),
    [
        (5, [-5.888247869776115 + 11.55634135862407j, -4.111752130223885 + 14.09372267514501j]),
        (20, [-34.80046987452894 + 1.242551902129871j, -5.199530125471059 + 4.143423423789674j]),
        (40, [-77.63031017793655 + 0.4440262672937696j, -2.369689822063447 + 3.533752217403184j]),
    ],
)
def test_a_car_on_tyres_with_relaxation(u, expected):
    found = mbstab.loads(CAR.format(**RELAXED)).eig(u=u)
    np.testing.assert_allclose(moving(found), expected, rtol=1e-12)


def test_a_car_whose_heading_is_changed_is_simulated():
    """Slip has no value at rest, which no part of the start needs."""
    run = mbstab.loads(CAR.format(**RELAXED)).simulate(to=0.1, points=2, perturb={"car.theta": 0.02})
    assert run.q[0][2] == 0.02
    assert run.u[0][0] == pytest.approx(10.0)


def test_an_oversteering_car_diverges_at_its_critical_speed():
    """The critical speed does not depend on the relaxation of the tyres."""
    for which in (STIFF, RELAXED):
        swept = mbstab.loads(CAR.format(**which)).sweep("u", np.linspace(20.0, 35.0, 4), a=1.696, b=1.189)
        assert [c.value for c in swept.critical] == pytest.approx([27.549672693062145985], rel=1e-10)


def test_a_joint_controller_with_a_lag():
    """(J + m l^2) θ'' = m g l cos … + τ, T τ' = -P θ - D θ' - τ, with a force along the speed of the tip."""
    l, P, D, T, g, m, J = 0.2, 30.0, 2.0, 0.01, 9.81, 1.0, 0.02  # noqa: E741
    mechanism = mbstab.loads(f"""\
mbstab: 1
gravity: [0, 0, -{g}]
bodies: {{rod: {{type: spatial, mass: {m}, inertia: [0.01, {J}, {J}], points: {{O: [-{l}, 0, 0], tip: [{l}, 0, 0]}}}}}}
joints: {{pivot: {{type: revolute, between: [rod.O, ground], axis: [y, y]}}}}
states: {{tau: {{rate: (-{P}*angle(pivot) - {D}*rate(angle(pivot)) - tau)/{T}}}}}
forces:
  motor: {{type: expression, on: {{angle(pivot): tau + {m * g * l}*cos(angle(pivot))*(-1)}}}}
  air: {{type: expression, on: {{vz(rod.tip): -0.1*vz(rod.tip)}}}}
reference: {{coordinates: {{rod: {{x: {l}, y: 0, z: 0, phi: 0, theta: 0, psi: 0}}}}}}
""")
    # Turning about y lowers the tip: the weight turns by m g l cos θ, which the motor takes away.
    inertia, drag = J + m * l * l, 0.1 * (2 * l) ** 2
    expected = np.roots([T * inertia, inertia + T * drag, D + drag, P])
    found = mechanism.eig()
    np.testing.assert_allclose(np.sort_complex(found.values()), np.sort_complex(expected), rtol=1e-12)
    precise = np.sort_complex([complex(x) for x in mechanism.eig_precise(20).values()])
    np.testing.assert_allclose(precise, np.sort_complex(expected), rtol=1e-13)


def test_a_kink_of_a_measure_is_seen():
    text = (
        "mbstab: 1\nbodies: {b: {type: planar, mass: 1, inertia: 1}}\n"
        "joints: {axle: {type: revolute, between: [b, ground]}}\n"
        "forces: {f: {type: expression, on: {angle(axle): '-2*angle(axle) - 3*smooth_start(angle(axle))'}}}\n"
    )
    assert mbstab.loads(text).eig().verdict == "undecided"
    smooth = text.replace("smooth_start(angle(axle))", "rate(angle(axle))")
    assert mbstab.loads(smooth).eig().verdict == "asymptotically stable"


def test_nothing_is_concluded_where_forces_have_values_nowhere_else():
    """Slip has no value at rest: states at which symmetries are tested are moving ones; without any, none is found."""
    text = CAR.format(**STIFF).replace("-C*atan(vy(car.rear)/vx(car.rear))", "sqrt(1e-30 - (rate(car.x) - u)**2)")
    neutral = mbstab.loads(text).eig().neutral_directions
    assert not any("speed" in name for name in neutral)


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("angle(nothing)", "there is no joint 'nothing'"),
        ("angle(slide)", "a prismatic joint has no angle, only displacement"),
        ("x(a.q)", "the body 'a' has no point 'q'"),
        ("x(c)", "there is no body 'c'"),
        ("wz(a)", "wz() does not exist in a planar scene"),
        ("distance(a)", "distance() takes a point and a point, got 1 name"),
        ("angle(3)", "angle() takes the name of a joint, found '3'"),
        ("rate(vx(a))", "rate(...) takes one coordinate or measure"),
        ("angel(turn)", "unknown function 'angel'"),
        ("force(turn.x)", "force() stands in outputs only"),
        ("acceleration(a.x)", "acceleration() stands in outputs only"),
    ],
)
def test_a_wrong_measure_is_refused(expression, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(f"mbstab: 1\n{BODIES[2]}forces: {{f: {{type: expression, on: {{a.x: '{expression}'}}}}}}\n")
    assert message in str(caught.value)
    assert "<text>:6:" in str(caught.value)


WRITTEN = [
    ("holonomic", "displacement(slide)"),
    ("holonomic", "sin(angle(turn))*distance(a.p, b) + b.theta*cos(t)"),
    ("holonomic", "x(a.p)**2*y(b.p)"),
    ("nonholonomic", "vx(a.p)*angle(turn) + rate(distance(a.p, b))"),
    ("nonholonomic", "rate(angle(turn))*x(b.p) - vy(b.p) + sin(t)"),
]


@pytest.mark.table
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("role", "text"), WRITTEN)
def test_derivatives_of_rows_are_differences_of_their_accelerations_and_forces(role, text, dimension):
    system = mbstab.loads(f'mbstab: 1\n{BODIES[dimension]}constraints: {{row: {{{role}: "{text}"}}}}\n').system()
    random = np.random.default_rng(3)
    q, u, a = (random.normal(size=system.n_q) for _ in range(3))
    nu, t, step = np.zeros(system.n_c), 0.3, 1e-6
    nu[-1 if role == "nonholonomic" else system.n_h - 1] = 1.0  # written rows are the last of their role
    row = int(np.argmax(nu))

    def acceleration(q, u):
        at = system.dynamics(q, u, t)
        return (at.J @ a + at.B)[row]

    def slopes(function, by_speed=False):
        moved = [(q, u + step * e) if by_speed else (q + step * e, u) for e in np.eye(system.n_q)]
        before = [(q, u - step * e) if by_speed else (q - step * e, u) for e in np.eye(system.n_q)]
        return np.transpose([(function(*x) - function(*y)) / (2.0 * step) for x, y in zip(moved, before, strict=True)])

    _, A_q, A_u = system.linearize_rows(q, u, a, t)
    K, R, _ = system.linearize(q, u, np.zeros_like(a), nu, t)
    K0, R0, _ = system.linearize(q, u, np.zeros_like(a), np.zeros_like(nu), t)
    for exact, found in (
        (A_q[row], slopes(acceleration)),
        (A_u[row], slopes(acceleration, by_speed=True)),
        (K - K0, slopes(lambda q, u: nu @ system.dynamics(q, u, t).J)),
        (R - R0, slopes(lambda q, u: nu @ system.dynamics(q, u, t).J, by_speed=True)),
    ):
        assert exact == pytest.approx(found, abs=1e-7 * (1.0 + np.max(np.abs(exact))))


@pytest.mark.parametrize(
    ("along", "message"),
    [
        ("angle(slide)", "has no angle"),
        ("rate(a.x)", "write a.x instead of rate(a.x)"),
        ("sin(angle(turn))", "a force cannot act along"),
    ],
)
def test_a_force_along_nothing_is_refused(along, message):
    with pytest.raises(ModelFileError) as caught:
        mbstab.loads(f"mbstab: 1\n{BODIES[2]}forces: {{f: {{type: expression, on: {{{along}: 1}}}}}}\n")
    assert message in str(caught.value)


def test_measures_do_not_stand_where_only_the_time_may():
    with pytest.raises(ModelFileError, match=r"measures such as 'angle\(turn\)' cannot be used here"):
        mbstab.loads(f"mbstab: 1\n{BODIES[2]}drives: {{d: {{type: joint, joint: turn, position: angle(turn)}}}}\n")


def test_the_text_for_users_lists_all_measures():
    assert [line.split("(")[0] for line in section_text("measures").splitlines()] == list(MEASURES)


def test_measures_are_read_like_names():
    assert parse("2*angle( pivot ) + vx(a.p)").names() == {"angle(pivot)": 2}
    assert parse("2*angle(pivot) + vx(a.p)").rates() == {"vx(a.p)": 17}
    with pytest.raises(ExpressionError):
        parse("angle(pivot")


def test_units_of_outputs_that_are_made_of_several_things():
    text = """
mbstab: 1
parameters: {k: {value: 1, unit: N*m}, c: {value: 1, unit: N/m}}
bodies: {a: {type: planar, mass: 1, inertia: 1}}
joints: {j: {type: revolute, between: [a, ground]}}
forces:
  s: {type: joint_spring, joint: j, stiffness: 1, damping: 0.1}
  e: {type: expression, on: {vx(a): -c*x(a)}}
outputs:
  sum: angle(j) + angle(j)
  less: -angle(j)
  between: angle(j) - a.theta
  rates: rate(angle(j)) + rate(a.theta)
  ratio: angle(j)/a.theta
  torque: effort(s)
  torques: effort(s) + k
  force: effort(e)
  power: effort(s)*rate(angle(j))
"""
    model = mbstab.loads(text).model
    units = {name: unit_of_output(model, x) for name, x in model.outputs.items()}
    assert units == {
        "sum": "rad", "less": "rad", "between": "rad", "rates": "rad/s", "ratio": "1", "torque": "N*m",
        "torques": "N*m", "force": "N", "power": "N*m/s",
    }  # fmt: skip
