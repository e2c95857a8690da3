"""Wheels, balls and disks on surfaces that move: turntables and treadmills, against closed forms and the fixed ground.

A ball of inertia k m R^2 about its centre on a plane that turns at the rate Omega about the vertical obeys
x'' = -kappa Omega y', y'' = kappa Omega x' with kappa = k/(1 + k), 2/7 for a solid one (Earnshaw 1844; Weltner 1979):
its centre moves on a circle at kappa Omega. On a treadmill all is as on the ground, seen from the belt (Galileo).
"""

import math

import numpy as np
import pytest

import mbstab
from mbstab.analysis.verdict.neutral import Separated, drift_of
from mbstab.analysis.verdict.rule import Neutral
from mbstab.errors import ModelFileError
from mbstab.model.library import models_folder

TABLE = """\
mbstab: 1
parameters: {{m: 2, R: 0.1, k: {k}, Omega: 3.5, x0: 0.3, v: 0.2}}
gravity: [0, 0, -9.81]
bodies: {{ball: {{type: spatial, mass: m, inertia: [k*m*R**2, k*m*R**2, k*m*R**2]}}}}
contacts: {{table: {{type: ellipsoid, center: ball, a: R, b: R, c: R, surface_rate: Omega}}}}
reference:
  coordinates: {{ball: {{x: {x}, y: 0, phi: 0, theta: 0, psi: 0}}}}
  rates: {{ball: {{x: {w}, y: {v}, phi: {phi}, theta: {w}/R, psi: 0}}}}
"""


def ball(k="0.4", x="0", v="0", w="0"):
    """Return a ball at (x, 0) with the speeds w and v along x and y; there the table moves at Omega x along y."""
    return mbstab.loads(TABLE.format(k=k, x=x, v=v, w=w, phi=f"(Omega*{x} - {v})/R"))


@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0], ids=["solid", "hollow"])
def test_the_linearized_ball_on_a_turntable_circles_at_its_share_of_the_rate(k):
    found = ball(k=repr(k)).eig()
    values = found.values()
    assert sorted(values.imag)[-1] == pytest.approx(k / (1.0 + k) * 3.5, rel=1e-12)
    assert sorted(abs(values))[:-2] == pytest.approx([0.0] * (len(values) - 2), abs=1e-5)


@pytest.mark.parametrize("k", [0.4, 2.0 / 3.0], ids=["solid", "hollow"])
def test_a_ball_on_a_turntable_moves_on_a_circle(k):
    rate = k / (1.0 + k) * 3.5
    run = ball(repr(k), "x0", "v").simulate(to=2.0 * math.pi / rate, points=9)
    angle, radius = rate * run.times, 0.2 / rate
    exact = np.column_stack([0.3 - radius + radius * np.cos(angle), radius * np.sin(angle)])
    np.testing.assert_allclose(run.q[:, :2], exact, atol=1e-9)
    assert np.ptp(run.kinetic) > 0.5 * np.max(run.kinetic)
    assert not run.conservative
    assert run.energy_drift < 1e-9 * np.max(run.kinetic)


def test_the_power_of_a_turntable_is_that_of_the_friction_on_its_surface():
    """The friction on the ball is m kappa Omega w along y, where the table moves at Omega x0."""
    found = ball(x="x0", w="v").energies()
    (share,) = (x for x in found.shares if "table" in x.owner)
    assert share.power == pytest.approx(2.0 * (2.0 / 7.0) * 3.5 * 0.2 * 3.5 * 0.3, rel=1e-12)
    assert found.total.power == share.power


BICYCLE = (models_folder() / "whipple_bicycle.yaml").read_text(encoding="utf-8")


def treadmill(text):
    """Return the bicycle with its frame at rest, on a belt that runs to the rear."""
    for contact in ("rear_wheel, axle: z, radius: r_R", "front_wheel, axle: z, radius: r_F"):
        text = text.replace(contact, f"{contact}, surface_velocity: [-v, 0, 0]")
    return text.replace("{x: v, y: 0", "{x: 0, y: 0")


@pytest.mark.parametrize("v", [1.0, 5.0])
def test_a_bicycle_on_a_treadmill_has_the_eigenvalues_of_one_on_the_road(v):
    road, belt = (mbstab.loads(x).eig(v=v) for x in (BICYCLE, treadmill(BICYCLE)))
    assert belt.verdict == road.verdict
    far, near = (x.values()[np.abs(x.values()) > 1e-3] for x in (road, belt))
    np.testing.assert_allclose(np.sort_complex(near), np.sort_complex(far), rtol=1e-9)
    assert len(near) == 4


def test_a_disturbed_bicycle_on_a_treadmill_moves_as_on_the_road():
    runs = [
        mbstab.loads(x).simulate(to=0.5, points=3, perturb={"rate(rear_body.phi)": 0.1})
        for x in (BICYCLE, treadmill(BICYCLE))
    ]
    road, belt = runs
    k = road.names.index("rear_body.x")
    np.testing.assert_allclose(belt.q[:, k] + 5.0 * belt.times, road.q[:, k], atol=1e-8)
    k = road.names.index("rear_body.phi")
    np.testing.assert_allclose(belt.q[:, k], road.q[:, k], atol=1e-8)
    assert belt.energy_drift < 1e-8 * np.max(road.kinetic)


DISK = """\
mbstab: 1
parameters: {{m: 2, R: 0.1, V: 0.7, A: 0.3}}
gravity: [0, -9.81]
bodies: {{disk: {{type: planar, mass: m, inertia: m*R**2/2}}}}
contacts: {{belt: {{type: disk, center: disk, radius: R, surface_velocity: {velocity}}}}}
reference:
  coordinates: {{disk: {{x: 0, theta: 0}}}}
  rates: {{disk: {{x: 0}}}}
"""


def test_a_disk_on_a_belt_that_speeds_up_has_a_third_of_its_acceleration():
    run = mbstab.loads(DISK.format(velocity="[V + A*t, 0]")).simulate(to=2.0, points=3)
    np.testing.assert_allclose(run.u[:, 0], 0.1 * run.times, atol=1e-10)
    np.testing.assert_allclose(run.u[:, 2], (0.7 + 0.2 * run.times) / 0.1, rtol=1e-10)
    assert run.energy_drift < 1e-9 * np.max(run.kinetic)


@pytest.mark.parametrize(
    ("kind", "contact"),
    [
        ("wheel", "axle: [0.1, 1, 0.3], radius: 0.3, tube: 0.05"),
        ("ellipsoid", "a: 0.3, b: 0.2, c: 0.25"),
    ],
)
def test_slip_counts_against_the_surface_at_the_contact(kind, contact):
    """On a plane at rest two states differ in slip by the velocity of the surface of a moving plane."""
    text = """\
mbstab: 1
bodies: {{b: {{type: spatial, mass: 1, inertia: [1, 1, 1], points: {{C: [0.1, 0.2, 0.3]}}}}}}
contacts: {{on: {{type: {kind}, center: b.C, {contact}, origin: [0.4, -0.2, 0.1]{more}}}}}
reference: {{guess: {{b: {{z: 1}}}}}}
"""
    moving = ", surface_velocity: [0.3, -0.4 + t, 0], surface_rate: 2 - 3*t"
    rest, carried = (mbstab.loads(text.format(kind=kind, contact=contact, more=more)).system() for more in ("", moving))
    q, u, t = np.array([0.3, 0.1, 0.8, 0.2, -0.3, 0.4]), np.array([0.5, 0.2, 0.1, 0.3, -0.7, 0.6]), 0.3
    at, there = rest.dynamics(q, u, t), carried.dynamics(q, u, t)
    np.testing.assert_array_equal(at.J, there.J)
    slips = [i for i, row in enumerate(rest.rows) if "slip" in str(row)]
    # A pure translation of the body with the velocity of the surface at the contact has no slip.
    V, rate, origin = np.array([0.3, -0.1, 0.0]), 1.1, np.array([0.4, -0.2, 0.1])
    h = 1e-6
    contact_point = touching(rest, q)
    surface = V + rate * np.cross([0.0, 0.0, 1.0], contact_point - origin)
    found = rest.dynamics(q, u - np.concatenate([surface, np.zeros(3)]), t)
    np.testing.assert_allclose(there.V[slips], found.V[slips], atol=1e-12)
    assert np.max(np.abs(there.V[slips] - at.V[slips])) > 0.1
    # The acceleration residual is the rate of the slip, the given functions included.
    a = np.linspace(-1.0, 1.0, 6)
    ahead, behind = (carried.dynamics(q + s * u + 0.5 * s * s * a, u + s * a, t + s).V for s in (h, -h))
    np.testing.assert_allclose((there.J @ a + there.B)[slips], (ahead - behind)[slips] / (2.0 * h), atol=1e-7)


def touching(system, q):
    """Return the contact point: where turns about axes through it, parallel to the plane, leave the slip as it is."""
    J = system.dynamics(q, np.zeros(6), 0.0).J
    slips = [i for i, row in enumerate(system.rows) if "slip" in str(row)]
    moved = J[slips][:, :2]
    # The slip of a turn about the vertical is that of its speed at the contact: z x (contact - place of the body).
    turn = vertical(q)
    speed = np.linalg.solve(moved, J[slips][:, 3:] @ turn)
    return q[:3] + np.array([speed[1], -speed[0], 0.0])


def vertical(q):
    """Return the rates of the Cardan angles of a turn about the vertical at unit rate."""
    phi, theta = q[3:5]
    c, s = np.cos, np.sin
    X = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    Y = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    axes = np.column_stack([[1, 0, 0], X @ [0, 1, 0], X @ Y @ [0, 0, 1]])
    return np.linalg.solve(axes, [0.0, 0.0, 1.0])


def test_a_surface_that_is_written_as_zero_is_one_at_rest():
    text = (models_folder() / "rolling_torus.yaml").read_text(encoding="utf-8")
    plain = mbstab.loads(text)
    written = mbstab.loads(text.replace("type: wheel,", "type: wheel, surface_velocity: [0, 0, 0], surface_rate: 0,"))
    assert written.eig().values().tolist() == plain.eig().values().tolist()
    assert written.model.document.lines != plain.model.document.lines
    assert plain.simulate(to=0.01, points=2).conservative
    assert written.simulate(to=0.01, points=2).conservative


def test_a_turning_surface_does_not_exist_in_the_plane():
    with pytest.raises(ModelFileError, match="unknown key 'surface_rate'"):
        mbstab.loads(DISK.format(velocity="0, surface_rate: 1"))


def test_a_tyre_on_a_moving_plane_is_refused():
    text = """\
mbstab: 1
bodies: {b: {type: spatial, mass: 1, inertia: [1, 1, 1]}}
contacts: {on: {type: wheel, center: b, axle: y, radius: 1, motion: sideways, surface_rate: 1}}
forces: {tyre: {type: tyre, contact: on, cornering_stiffness: 5}}
reference: {guess: {b: {z: 1}}}
"""
    with pytest.raises(ModelFileError, match=r":4:.*moving plane \(surface_rate\), and slip counts against a plane at"):
        mbstab.loads(text)


# --- verdicts -------------------------------------------------------------------------------------------------------

TURNTABLE = mbstab.load(models_folder() / "turntable.yaml")


@pytest.mark.parametrize(
    "values",
    [{"m": 1e-6}, {"R": 1e-5}, {"R": 1e4}, {"Omega": 1e-5}, {"Omega": 1e5}, {"k": 1e-6}, {"x0": 1e6}, {"x0": 1e-6}],
    ids=lambda values: " ".join(f"{name}={value}" for name, value in values.items()),
)
@pytest.mark.parametrize("middle", [False, True])
def test_a_ball_on_a_turntable_is_stable_up_to_symmetry(values, middle):
    values |= {"x0": 0.0} if middle else {}
    found = TURNTABLE.eig(**values)
    assert found.verdict == "stable up to symmetry"
    k, rate = values.get("k", 0.4), values.get("Omega", 3.5)
    (pair,) = (x for x in found.eigenvalues if x.value.imag > 0.0 and x.kind != "neutral")
    assert abs(pair.value - 1j * k / (1.0 + k) * rate) <= pair.error_bound + 4e-16 * rate


@pytest.mark.parametrize("x0", [1e-7, 1e-6, 1e-5, 1e-3])
def test_symmetries_that_nearly_agree_lose_no_digits(x0):
    """Near the middle a turn of the table is nearly one of the ball: their difference has few digits."""
    for found in (TURNTABLE.eig(x0=x0), TURNTABLE.eig(x0=x0, method="index3")):
        (pair,) = (x for x in found.eigenvalues if x.value.imag > 0.0 and x.kind != "neutral")
        assert abs(pair.value - 1j) <= pair.error_bound < 1e-12


def test_a_spinning_ball_in_the_middle_is_judged():
    text = TABLE.replace("psi: 0}}}}\n", "psi: 4}}}}\n").format(k=0.4, x=0, w=0, v=0, phi=0)
    assert "psi: 4" in text.splitlines()[-1]
    assert mbstab.loads(text).eig().verdict == "stable up to symmetry"


@pytest.mark.parametrize("push", ["1e-13*ball.x", "-1e-13*ball.x", "1e-9*ball.x**2"])
def test_a_weak_force_beside_a_turntable_is_not_overlooked(push):
    text = TABLE.format(k=0.4, x=0, w=0, v=0, phi=0) + f"forces: {{push: {{type: expression, on: {{ball.x: {push}}}}}}}"
    assert mbstab.loads(text).eig().verdict in ("undecided", "marginally stable")


def test_a_ball_in_a_bowl_and_two_balls_on_a_spring_are_stable_up_to_their_own_turns():
    """In a bowl a ball swings at sqrt(g/((1 + k)(B - R))), two balls on a spring at sqrt(2 c/((1 + k) m))."""
    bowl = """\
mbstab: 1
parameters: {m: 2, R: 0.1, k: 0.4, B: 1.1}
gravity: [0, 0, -9.81]
bodies: {ball: {type: spatial, mass: m, inertia: [k*m*R**2, k*m*R**2, k*m*R**2]}}
joints: {bowl: {type: distance, between: [{body: ground, point: [0, 0, B]}, ball], length: B-R}}
definitions:
  ox: "rate(ball.phi) + rate(ball.psi)*sin(ball.theta)"
  oy: "rate(ball.theta)*cos(ball.phi) - rate(ball.psi)*sin(ball.phi)*cos(ball.theta)"
  oz: "rate(ball.theta)*sin(ball.phi) + rate(ball.psi)*cos(ball.phi)*cos(ball.theta)"
constraints:
  along: {nonholonomic: "rate(ball.x) + R*(oy*(ball.z - B) - oz*ball.y)/(B - R)"}
  across: {nonholonomic: "rate(ball.y) + R*(oz*ball.x - ox*(ball.z - B))/(B - R)"}
reference: {coordinates: {ball: {x: 0, y: 0, z: R, phi: 0, theta: 0, psi: 0}}}
"""
    body = "{type: spatial, mass: 2, inertia: [0.008, 0.008, 0.008]}"
    two = f"""\
mbstab: 1
gravity: [0, 0, -9.81]
bodies: {{a: {body}, b: {body}}}
contacts:
  first: {{type: ellipsoid, center: a, a: 0.1, b: 0.1, c: 0.1}}
  second: {{type: ellipsoid, center: b, a: 0.1, b: 0.1, c: 0.1}}
forces: {{spring: {{type: spring, between: [a, b], stiffness: 100, length: 1}}}}
reference: {{coordinates: {{a: {{x: 0, y: 0}}, b: {{x: 1, y: 0}}}}}}
"""
    for text, square in ((bowl, 9.81 / 1.4), (two, 200.0 / 2.8)):
        found = mbstab.loads(text).eig()
        assert found.verdict == "stable up to symmetry"
        assert max(found.values().imag) == pytest.approx(math.sqrt(square), rel=1e-12)


@pytest.mark.parametrize("x0", [3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 3e-9])
def test_a_ball_that_hardly_turns_is_left_behind_like_t(x0):
    """Another angular velocity turns a ball ever further, whatever its own rate Omega x0/R is: like t, not like t^2."""
    assert TURNTABLE.eig(x0=x0).reasons[0].endswith("goes on growing like t")


@pytest.mark.parametrize("rate", [1.0, 1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize(("turned", "power"), [(True, 0), (False, 1)])
def test_the_growth_of_neutral_directions_does_not_depend_on_how_slowly_they_turn(rate, turned, power):
    """A constant speed drives x, y or the angle z of a frame that turns: x and y stay bounded, z grows like t."""
    S = np.zeros((4, 4))
    S[0, 1], S[1, 0] = -rate, rate
    S[:3, 3] = [1.0, 0.5, 0.0 if turned else 1.0]
    basis = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
    mixed = basis @ S @ basis.T
    found = Separated(mixed, np.eye(4), np.zeros((0, 4)), np.zeros((4, 0)), Neutral())
    assert drift_of(found) == power
    two = np.kron(np.eye(2), S)
    two[3, 4:7] = [0.0, 0.0, rate]  # the angle of the second drives the speed of the first
    found = Separated(two, np.eye(8), np.zeros((0, 8)), np.zeros((8, 0)), Neutral())
    assert drift_of(found) == (1 if turned else 3)


def test_slow_turns_of_a_ball_on_a_turntable_move_no_eigenvalue_of_the_fast_one():
    """Directions that are nearly dependent span a space that S leaves: ±i keep their bounds."""
    places = [3.0000000000000004e-05, 2.1402966057353745e-05, *10.0 ** np.random.default_rng(1).uniform(-9, 1, 40)]
    for x0 in places:
        found = TURNTABLE.eig(x0=float(x0))
        (fast,) = (e for e in found.eigenvalues if abs(e.value - 1j) < 1e-3)
        assert abs(fast.value - 1j) <= fast.error_bound
        assert str(found.verdict) == "stable up to symmetry", x0
